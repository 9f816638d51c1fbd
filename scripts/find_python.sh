#!/usr/bin/env bash
# The path of an interpreter of one version: on the PATH, of pyenv or of uv. Where there is none, how to get it.
#
# usage: scripts/find_python.sh 3.12
set -euo pipefail

version=$1

is_it() { # it is run, because a name on the path may be a shim of nothing
    "$1" -c "import sys; sys.exit('%d.%d' % sys.version_info[:2] != '$version')" 2>/dev/null
}

candidates=("$(command -v "python$version" || true)")
if command -v pyenv >/dev/null; then
    for python in "$(pyenv root)/versions/$version".*/bin/python; do candidates+=("$python"); done
fi
if command -v uv >/dev/null; then candidates+=("$(uv python find --no-project "$version" 2>/dev/null || true)"); fi
for python in "${candidates[@]}"; do
    if [ -n "$python" ] && is_it "$python"; then
        echo "$python"
        exit 0
    fi
done
printf '%s\n' "error: there is no Python $version on this machine. One of these brings it, then run make again:" \
    "    apt-get install python$version python$version-venv    # where the distribution has it" \
    "    uv python install $version" \
    "    pyenv install $version" >&2
exit 1
