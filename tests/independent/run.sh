#!/usr/bin/env bash
# run.sh RECORDING.bag OUT | --self-test | --map ..: oracle.py, or map.py, in an environment of its own
# under target/.
# Needs python3 >= 3.10 with venv; the packages come from PyPI on the first run only.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
venv=${CARGO_TARGET_DIR:-$here/../../target}/oracle-venv
stamp=$venv/requirements.txt
mkdir -p "$(dirname "$venv")"
(
    flock 9 # tests run in parallel: one of them installs
    if ! cmp -s "$here/requirements.txt" "$stamp"; then
        python3 -m venv --clear "$venv"
        "$venv/bin/python" -m pip install --quiet --disable-pip-version-check \
            -r "$here/requirements.txt"
        cp "$here/requirements.txt" "$stamp"
    fi
) 9>"$venv.lock"
export PYTHONDONTWRITEBYTECODE=1
program=oracle.py
if [ "${1-}" = --map ]; then
    program=map.py
    shift
fi
exec "$venv/bin/python" "$here/$program" "$@"
