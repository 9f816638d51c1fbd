#!/usr/bin/env bash
# Makes .venv from nothing: system libraries, a virtual environment, the packages that constraints.txt pins, and this
# package in editable mode. Called by make; returns at once when nothing has changed since it last finished.
#
# usage: [PYTHON=python3.12] [VENV=.venvs/3.12] scripts/setup.sh [--tests]
#
# VENV: another folder than .venv, for a second version of Python beside it (make test-3.12).
# --tests: also the programs that only tests start: a browser, for pages, and LaTeX, for tables.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

extras=gpl,learned,joblib,tune,render,scenes,dev
venv=${VENV:-.venv}
unfinished=$venv/.installing # there while a set-up is under way: what was interrupted is made anew
finished=$venv/.installed    # what the last complete set-up was made from

export PIP_DISABLE_PIP_VERSION_CHECK=1

say() { printf 'setup: %s\n' "$*" >&2; }
stop() {
    printf 'setup: error: %s\n' "$@" >&2
    exit 1
}

# --- what is there -----------------------------------------------------------------------------------------------

state() { # all that a finished environment depends on; its scripts hold its path
    pwd
    cat pyproject.toml constraints.txt scripts/setup.sh
    grep "^__version__" bench/__init__.py # the metadata of the installed package repeats it
}

version() { "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null; }

suitable() { "$1" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null; }

wanted_version() { # the environment runs, with the interpreter asked for if one was
    suitable "$venv"/bin/python && { [ -z "${PYTHON:-}" ] || [ "$(version "$venv/bin/python")" = "$(version "$PYTHON")" ]; }
}

moved() { [ -e "$finished" ] && [ "$(head -n 1 "$finished")" != "$PWD" ]; }

complete() { [ ! -e "$unfinished" ] && wanted_version && state | cmp -s - "$finished"; }

find_python() {
    if [ -n "${PYTHON:-}" ]; then
        suitable "$PYTHON" || stop "PYTHON=$PYTHON does not run as Python 3.11, 3.12 or 3.13; give the path of one that does"
        echo "$PYTHON"
        return
    fi
    local candidate
    for candidate in python3.12 python3.11 python3.13 python3; do # cgal has no build for 3.13
        if suitable "$candidate"; then # it is run, because a name on the path may be a shim of nothing
            echo "$candidate"
            return
        fi
    done
    stop "Python 3.11, 3.12 or 3.13 is needed, and none is on the path; install one, or: make setup PYTHON=/path/to/python3"
}

# --- system libraries ----------------------------------------------------------------------------------------------

missing_packages() { # the Debian packages of what cannot be loaded; without libOpenGL pymeshlab loses filters silently
    "$1" - <<'PYTHON_END'
import ctypes
import importlib.util
import sys

libraries = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libOpenGL.so.0": "libopengl0",
}
if sys.platform == "linux":
    for library, package in libraries.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            print(package)
if importlib.util.find_spec("ensurepip") is None:
    print("python%d.%d-venv" % sys.version_info[:2])
PYTHON_END
}

install_packages() {
    local line="apt-get install -y --no-install-recommends $*" root=()
    command -v apt-get >/dev/null || stop "system packages are missing; their Debian names are: $*"
    if [ "$(id -u)" != 0 ]; then
        sudo -n true 2>/dev/null || stop "system packages are missing; install them, then run make again:" "    sudo apt-get update && sudo $line"
        root=(sudo -n)
    fi
    say "installing system packages: $*"
    # An update that fails in part (a foreign source) may still have what is needed.
    "${root[@]+"${root[@]}"}" apt-get update -qq || say "apt-get update failed; trying with the lists at hand"
    # shellcheck disable=SC2086
    "${root[@]+"${root[@]}"}" env DEBIAN_FRONTEND=noninteractive $line -qq >/dev/null ||
        stop "the system packages could not be installed; this has to succeed first:" "    sudo $line"
}

system_packages() {
    local missing
    missing=$(missing_packages "$1")
    [ -n "$missing" ] || return 0
    # shellcheck disable=SC2086
    install_packages $missing
    missing=$(missing_packages "$1")
    [ -z "$missing" ] || stop "still cannot be loaded after their installation:" $missing
}

test_programs() {
    local missing=()
    command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null ||
        missing+=(chromium)
    command -v pdflatex >/dev/null || missing+=(texlive-latex-base texlive-latex-recommended)
    [ ${#missing[@]} = 0 ] || install_packages "${missing[@]}"
}

# --- the environment -----------------------------------------------------------------------------------------------

pip() { "$venv"/bin/python -m pip install ${quiet:+"$quiet"} "$@"; }

torch() { # from wheels at hand, otherwise from PyTorch's own index: the one on PyPI brings gigabytes of CUDA on Linux
    local version
    version=$(sed -n 's/^torch==//p' constraints.txt)
    if [ "$(uname)" != Linux ]; then
        pip --no-deps "torch==$version"
        return
    fi
    pip --no-deps "torch==$version+cpu" >/dev/null 2>&1 ||
        pip --no-deps "torch==$version+cpu" --index-url https://download.pytorch.org/whl/cpu ||
        stop "the CPU build of torch $version could not be installed (for Python $(version "$venv/bin/python"));" \
            "    it is looked for in pip's find-links and at https://download.pytorch.org/whl/cpu"
}

check() {
    "$venv"/bin/python - <<'PYTHON_END'
import sys

import bench.cli
import torch

if torch.version.cuda is not None and sys.platform == "linux":
    sys.exit(f"setup: error: torch {torch.__version__} is a CUDA build; the CPU build was asked for")
PYTHON_END
}

[ "${1:-}" != --tests ] || test_programs
if complete; then
    [ -z "$(missing_packages "$venv"/bin/python)" ] || system_packages "$venv"/bin/python
    exit 0
fi

python=$(find_python)
system_packages "$python"

if [ -e "$unfinished" ] || moved || ! wanted_version; then anew=yes; else anew=; fi
mkdir -p "$venv"
state >"$unfinished"
rm -f "$finished"
if [ -n "$anew" ]; then # the mark stays: this may be interrupted too
    find "$venv" -mindepth 1 -maxdepth 1 ! -path "$unfinished" -exec rm -rf {} +
fi

quiet=-q
if [ -t 1 ]; then quiet=; fi
say "packages go into $venv ($("$python" -V)), which takes 3 GB; the first time this downloads about 1 GB"
if ! "$python" -c 'import sys; sys.exit(sys.version_info >= (3, 13))'; then
    say "CGAL has no build for Python 3.13: the methods that need it will be skipped. Python 3.12 has all of them"
fi
[ -x "$venv"/bin/pip ] || "$python" -m venv "$venv"
# What builds this package is pinned too, so it is built in the environment itself and not in one that pip makes up.
pip -c constraints.txt setuptools wheel
torch
pip -c constraints.txt --no-build-isolation -e ".[$extras]"
check
mv "$unfinished" "$finished" # only now is it believed complete
say "done"
