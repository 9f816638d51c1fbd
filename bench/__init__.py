"""detailbench: an honest benchmark for geometry processing.

Everything a plugin author needs is importable from here, and the import is light: the modules behind a name load
on its first use. The distribution and the command are called ``detailbench``.
"""

from __future__ import annotations

import sys

if sys.argv[:1] == ["-m"] and not sys.flags.safe_path and {"bench", "-mbench"} & set(sys.orig_argv[1:]):
    del sys.path[0]  # `python -m bench`: the working folder, before anything in it can be imported

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_EXPORTS = {
    "register": "plugins.registry",
    "PointCloud": "geometry.cloud",
    "Shape": "contract.shape",
    "PoseTransfer": "contract.shape",
    "ShapePair": "contract.shape",
    "Effect": "contract.sensors",
    "Surface": "contract.shape",
    "Frame": "geometry.cloud",
    "Case": "contract.case",
    "Views": "contract.views",
    "Run": "contract.run",
    "TrainingData": "contract.training",
    "Task": "contract.task",
    "CaseRecipe": "contract.task",
    "validate_cloud": "contract.task",
    "validate_mesh": "contract.task",
    "BadInput": "errors",
    "InvalidOutput": "errors",
    "MissingData": "errors",
    "MissingLibrary": "errors",
    "UsageError": "errors",
    "build_parts": "plugins.parts",
    "generator": "seeds",
    "notice": "notices",
    "snake_case": "plugins.declared",
    "Plugin": "plugins.registry",
    "Step": "contract.sensors",
    "build_steps": "contract.sensors",
    "given_by": "contract.sensors",
}
__all__ = [
    "BadInput",
    "Case",
    "CaseRecipe",
    "Effect",
    "Frame",
    "InvalidOutput",
    "MissingData",
    "MissingLibrary",
    "Plugin",
    "PointCloud",
    "Run",
    "Shape",
    "PoseTransfer",
    "ShapePair",
    "Step",
    "Surface",
    "Task",
    "TrainingData",
    "UsageError",
    "Views",
    "build_parts",
    "build_steps",
    "generator",
    "given_by",
    "notice",
    "register",
    "snake_case",
    "validate_cloud",
    "validate_mesh",
]

if TYPE_CHECKING:
    from .contract.case import Case
    from .contract.run import Run
    from .contract.sensors import Effect, Step, build_steps, given_by
    from .contract.shape import PoseTransfer, Shape, ShapePair, Surface
    from .contract.task import CaseRecipe, Task, validate_cloud, validate_mesh
    from .contract.training import TrainingData
    from .contract.views import Views
    from .errors import BadInput, InvalidOutput, MissingData, MissingLibrary, UsageError
    from .geometry.cloud import Frame, PointCloud
    from .notices import notice
    from .plugins.declared import snake_case
    from .plugins.parts import build_parts
    from .plugins.registry import Plugin, register
    from .seeds import generator


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        raise AttributeError(f"module 'bench' has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_EXPORTS[name]}", __name__), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
