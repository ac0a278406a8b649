#!/usr/bin/env bash
# clients.sh SCRIPT ARGUMENTS..: a program of deploy/python. In an environment of its own under target/;
# the packages come from PyPI on the first run only.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
venv=${CARGO_TARGET_DIR:-$here/../../target}/clients-venv
stamp=$venv/requirements.txt
mkdir -p "$(dirname "$venv")"
(
    flock 9 # tests run in parallel: one of them installs
    if ! cmp -s "$here/requirements-clients.txt" "$stamp"; then
        python3 -m venv --clear "$venv"
        "$venv/bin/python" -m pip install --quiet --disable-pip-version-check \
            -r "$here/requirements-clients.txt"
        cp "$here/requirements-clients.txt" "$stamp"
    fi
) 9>"$venv.lock"
export PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1
exec "$venv/bin/python" "$here/../../deploy/python/$@"
