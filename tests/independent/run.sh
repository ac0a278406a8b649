#!/usr/bin/env bash
# run.sh RECORDING.bag OUT | --self-test | --map ..: oracle.py, or map.py, in an environment of its own
# under target/.
# Needs python3 >= 3.10 with venv; the packages come from PyPI on the first run only.
set -euo pipefail
. "$(dirname "$0")/venv.sh"
in_venv oracle requirements.txt
program=oracle.py
if [ "${1-}" = --map ]; then
    program=map.py
    shift
fi
exec "$venv/bin/python" "$here/$program" "$@"
