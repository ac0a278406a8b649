#!/usr/bin/env bash
# recordings.sh decode BAG EXPECTED.json | make OUT: our recordings in the programs of others, and
# theirs for us. In an environment of its own under target/; the packages come from PyPI on the first run only.
set -euo pipefail
. "$(dirname "$0")/venv.sh"
in_venv recordings requirements-recordings.txt
exec "$venv/bin/python" "$here/recordings.py" "$@"
