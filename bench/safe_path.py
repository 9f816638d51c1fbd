"""The working folder is no place for modules: a ``random.py`` or a folder ``bench/`` there must not be imported.

Python puts the current directory first on ``sys.path`` for ``python -c`` and ``python -m``, and an empty entry of
``PYTHONPATH`` means it, too (``PYTHONPATH=$PYTHONPATH:/lib`` with nothing set before). A file that happens to lie
there would replace a library, in the front door and in every process that it starts; inside a folder that somebody
downloaded that runs a stranger's code. What ``PYTHONPATH`` names in full is kept: the user asked for it.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator

SAFE_PATH = "PYTHONSAFEPATH"  # Python's own variable: where it is not empty, the current directory stays out
OURS = "detailbench"  # our value of it, which says that the user did not set it


def leave_out_working_folder() -> None:
    """Take the current directory off this process's ``sys.path``, unless ``PYTHONPATH`` names it."""
    with contextlib.suppress(FileNotFoundError):  # a working folder that was deleted
        here = os.path.realpath(os.getcwd())
        named = {os.path.realpath(entry) for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry}
        accident = here not in named and "" in os.environ.get("PYTHONPATH", "x").split(os.pathsep)
        sys.path[:] = [p for p in sys.path if p and not (accident and os.path.realpath(p) == here)]


def environment() -> dict[str, str]:
    """The environment for a process started with ``-P``: without empty entries of ``PYTHONPATH``.

    Without our own :data:`SAFE_PATH` either: scripts that a method starts find the modules beside them, as usual.
    """
    kept = {key: value for key, value in os.environ.items() if (key, value) != (SAFE_PATH, OURS)}
    if "PYTHONPATH" in kept:
        kept["PYTHONPATH"] = os.pathsep.join(entry for entry in kept["PYTHONPATH"].split(os.pathsep) if entry)
    return kept


@contextlib.contextmanager
def safe_children() -> Iterator[None]:
    """Inside, every Python process that anybody starts from here (a launcher, say) leaves the working folder out."""
    before = {key: os.environ.get(key) for key in (SAFE_PATH, "PYTHONPATH")}
    os.environ.update(environment())
    os.environ.setdefault(SAFE_PATH, OURS)
    try:
        yield
    finally:
        for key, value in before.items():
            os.environ.pop(key, None) if value is None else os.environ.update({key: value})
