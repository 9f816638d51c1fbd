"""detailbench: an honest benchmark for geometry processing.

All that the author of a plugin needs is importable from here, and the import is light: what a name needs is loaded
when it is first used. The distribution and the command are called ``detailbench``.
"""

from __future__ import annotations

import sys

if sys.argv[:1] == ["-m"] and not sys.flags.safe_path and {"bench", "-mbench"} & set(sys.orig_argv[1:]):
    del sys.path[0]  # `python -m bench`: the working folder, before anything in it can be imported

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_EXPORTS = {
    "register": "registry",
    "PointCloud": "shapes",
    "Shape": "shapes",
    "ShapePair": "shapes",
    "Effect": "sensors",
    "Surface": "shapes",
    "Frame": "shapes",
    "Case": "shapes",
    "Views": "views",
    "Run": "run",
    "Task": "tasks",
    "CaseRecipe": "tasks",
    "validate_cloud": "tasks",
    "validate_mesh": "tasks",
    "BadInput": "errors",
    "InvalidOutput": "errors",
    "MissingLibrary": "errors",
    "UsageError": "errors",
    "build_parts": "parts",
    "generator": "seeds",
}
__all__ = [
    "BadInput",
    "Case",
    "CaseRecipe",
    "Effect",
    "Frame",
    "InvalidOutput",
    "MissingLibrary",
    "PointCloud",
    "Run",
    "Shape",
    "ShapePair",
    "Surface",
    "Task",
    "UsageError",
    "Views",
    "build_parts",
    "generator",
    "register",
    "validate_cloud",
    "validate_mesh",
]

if TYPE_CHECKING:
    from .errors import BadInput, InvalidOutput, MissingLibrary, UsageError
    from .parts import build_parts
    from .registry import register
    from .run import Run
    from .seeds import generator
    from .sensors import Effect
    from .shapes import Case, Frame, PointCloud, Shape, ShapePair, Surface
    from .tasks import CaseRecipe, Task, validate_cloud, validate_mesh
    from .views import Views


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        raise AttributeError(f"module 'bench' has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_EXPORTS[name]}", __name__), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
