#!/usr/bin/env bash
# The tests with the lowest versions that setup.cfg allows on the oldest Python, then with the newest on a newer one.
# tests/versions.sh                                       all tests, twice
# tests/versions.sh lowest -n 2 tests/netlib              one of the two; the rest are arguments of pytest
# LOWEST=/path/python3.10 NEWEST=/path/python3.13         other interpreters than those on PATH
# VENVS=/path                                             where the two virtual environments are made and kept
set -euo pipefail
cd "$(dirname "$0")/.."
venvs=${VENVS:-.venv/versions}

# "name==version" for each "name>=version" of setup.cfg
lowest() {
    sed -nE 's/^ +([A-Za-z0-9_-]+)>=([0-9.]+).*/\1==\2/p' setup.cfg | sort -u
}

check() {
    local which=$1 python=$2
    shift 2
    mkdir -p "$venvs"
    [ "$which" = lowest ] && lowest >"$venvs/$which.txt" || : >"$venvs/$which.txt"
    [ -x "$venvs/$which/bin/python" ] || "$python" -m venv "$venvs/$which"
    "$venvs/$which/bin/python" -m pip install --quiet --disable-pip-version-check --upgrade \
        --constraint "$venvs/$which.txt" -e '.[test]'
    echo "$which: $("$venvs/$which/bin/python" --version)"
    "$venvs/$which/bin/python" -m pytest -q "${@:--nauto}"
}

only=both
case ${1:-} in lowest | newest) only=$1 && shift ;; esac
[ "$only" = newest ] || check lowest "${LOWEST:-python3.10}" "$@"
[ "$only" = lowest ] || check newest "${NEWEST:-python3.13}" "$@"
