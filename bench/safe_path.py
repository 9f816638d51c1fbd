"""The working folder is no place for modules: a ``random.py`` or a folder ``bench/`` there must not be imported.

Python puts the current directory first on ``sys.path`` for ``python -c`` and ``python -m``, and an empty entry of
``PYTHONPATH`` means it, too (``PYTHONPATH=$PYTHONPATH:/lib`` with nothing set before). A file that happens to lie
there would replace a library, in the front door and in every process that it starts; inside a folder that somebody
downloaded that runs a stranger's code. What ``PYTHONPATH`` names in full is kept: the user asked for it.

The folder of a ``--plugin`` file is searched while that is imported, so that it finds its neighbours; modules of the
standard library come from the standard library all the same.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from typing import Any

SAFE_PATH = "PYTHONSAFEPATH"  # Python's own variable: where it is not empty, the current directory stays out
OURS = "detailbench"  # our value of it, which shows that the user did not set it


class StandardFirst:
    """An importer that finds modules of the standard library where Python has them, and no others."""

    library = os.path.dirname(os.__file__)
    folders = (library, os.path.join(library, "lib-dynload"))

    @classmethod
    def find_spec(cls, name: str, path: Sequence[str] | None = None, target: Any = None) -> ModuleSpec | None:
        """The module, if it is a top-level one of the standard library."""
        if path is None and name in sys.stdlib_module_names:
            return PathFinder.find_spec(name, cls.folders)
        return None


def isolate_imports() -> None:
    """Let no file of the working folder, and none beside a plugin, stand for a module of this process.

    Takes the current directory off ``sys.path``, unless ``PYTHONPATH`` names it.
    """
    if StandardFirst not in sys.meta_path:
        sys.meta_path.insert(sys.meta_path.index(PathFinder) if PathFinder in sys.meta_path else 0, StandardFirst)
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
