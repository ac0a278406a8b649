#!/usr/bin/env bash
# clients.sh SCRIPT ARGUMENTS..: a program of deploy/python. In an environment of its own under target/;
# the packages come from PyPI on the first run only.
set -euo pipefail
. "$(dirname "$0")/venv.sh"
in_venv clients requirements-clients.txt
export PYTHONUNBUFFERED=1
exec "$venv/bin/python" "$here/../../deploy/python/$@"
