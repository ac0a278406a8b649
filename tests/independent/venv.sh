# shellcheck shell=bash
# To be sourced: `in_venv NAME REQUIREMENTS` makes the environment target/NAME-venv with the packages of a
# file beside this one (from PyPI, on the first run only), and says where it is in $venv.
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
export PYTHONDONTWRITEBYTECODE=1

in_venv() {
    local requirements=$here/$2
    venv=${CARGO_TARGET_DIR:-$here/../../target}/$1-venv
    mkdir -p "$(dirname "$venv")"
    (
        flock 9 # tests run in parallel: one of them installs
        if ! cmp -s "$requirements" "$venv/requirements.txt"; then
            python3 -m venv --clear "$venv"
            "$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "$requirements"
            cp "$requirements" "$venv/requirements.txt"
        fi
    ) 9>"$venv.lock"
}
