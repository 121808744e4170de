#!/bin/sh
# Make .venv if it is not there, and install what a requirements file pins.
# usage: scripts/venv.sh run|cockpit|test
set -eu
cd "$(dirname "$0")/.."
what=${1:-run}

say() { printf '%s\n' "$*" >&2; }

# A pyenv shim can stand on the PATH and fail: run each candidate before believing it.
usable() {
    "$1" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null
}

make_venv() {
    without_venv=
    for python in python3 python3.12 python3.13 python3.11 python; do
        usable "$python" || continue
        if "$python" -c 'import venv, ensurepip' 2>/dev/null && "$python" -m venv .venv; then
            return 0
        fi
        rm -rf .venv
        without_venv=$python
    done
    if command -v uv >/dev/null 2>&1 && uv venv --seed --python '>=3.11,<3.14' .venv; then
        return 0
    fi
    rm -rf .venv
    if [ -n "$without_venv" ]; then
        say "$without_venv has no venv module. Install it (on Debian and Ubuntu: apt install python3-venv) and try again."
    else
        say "No Python 3.11, 3.12 or 3.13 found. Install one (on Debian and Ubuntu: apt install python3 python3-venv), or uv, and try again."
    fi
    exit 1
}

if [ "$(uname -s)-$(uname -m)" != Linux-x86_64 ]; then
    say "The ROS 2 wheels are for x86-64 Linux; this is $(uname -s) on $(uname -m)."
    say "On other machines install ROS 2 Jazzy and build with colcon: see README.md."
    exit 1
fi
export HOME="${HOME:-/tmp}" # ROS 2 writes its logs there

if ! { [ -x .venv/bin/python ] && usable .venv/bin/python; }; then
    rm -rf .venv
    say "Making .venv ..."
    make_venv
fi

mark=.venv/.installed
for done in "$what" $([ "$what" = run ] && echo cockpit) test; do
    # setup.py names the parts that others find by name, so a new one is installed anew.
    if [ -f "$mark.$done" ] && cat "requirements/$done.txt" setup.py | cmp -s - "$mark.$done"; then
        exit 0
    fi
done
say "Installing pinned requirements into .venv (about a minute, once) ..."
.venv/bin/python -m pip install --disable-pip-version-check --quiet --require-hashes \
    -r "requirements/$what.txt"
.venv/bin/python -m pip install --disable-pip-version-check --quiet --no-deps \
    --no-build-isolation --no-index --editable .
cat "requirements/$what.txt" setup.py >"$mark.$what"
