"""The checks of ``detailbench check`` for a learned method: examples, a few steps, weights in a file, a checkpoint."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..contract.case import Case
from ..contract.run import Run
from ..contract.task import CaseRecipe
from ..contract.training import TrainingData
from ..errors import InvalidOutput, UsageError
from ..plan.training import named
from ..plugins.registry import Plugin, registry
from ..plugins.schema import build
from ..plugins.weights import as_bytes, load
from .dataset_checks import digest_arrays

CASES = 4
STEPS = 6  # of the trial training: calls of run.checkpoint(), one after each step
LOOKS = 50  # queries of the remaining time before a training without checkpoints ends


class _Counted(Run):
    """A run whose time is counted in steps, so that it always ends at the same step."""

    steps: int = 0  # completed
    looks: int = 0
    end: int = STEPS
    stored: Mapping[str, np.ndarray] | None = None

    def seconds_left(self) -> float:
        """Positive until the given number of steps is done."""
        self.looks += 1
        return 1.0 if self.steps < self.end and (self.steps or self.looks < LOOKS) else 0.0

    def checkpoint(self, make: Callable[[], Mapping[str, np.ndarray]]) -> None:
        """Save at every call."""
        self.steps += 1
        self.stored = {name: np.array(array) for name, array in make().items()}


def learning_checks(run: Callable[..., dict[str, Any]], folder: Path) -> Iterator[tuple[str, str, str]]:
    """Name, verdict and detail of each check; the weights are left in ``folder``."""
    first = run("learn", folder=str(folder), resume=False)
    if first["status"] != "ok":
        yield "learning: examples and a few steps", "fail", f"{first['status']}: {first['message']}"
        return
    yield "learning: examples and a few steps", "ok", first["output"]
    again = run("learn", folder="", resume=False)
    same = again.get("digest") == first["digest"]
    hint = "" if same else "draw from generators made of run.seed and the number of the step"
    yield "learning: same seed, same weights", "ok" if same else "fail", hint
    if first["checkpoints"] == 0:
        yield (
            "learning: continues from a checkpoint",
            "warn",
            "fit never calls run.checkpoint(): a kill loses all steps",
        )
        return
    resumed = run("learn", folder="", resume=True)
    same = resumed.get("digest") == first["digest"]
    hint = resumed["message"] if resumed["status"] != "ok" else "not the weights of an uninterrupted training"
    yield "learning: continues from a checkpoint", "ok" if same else "fail", "" if same else hint


def learn(
    plugin: Plugin, asked: Mapping[str, Any], spec: Mapping[str, Any], toys: Callable[[Any], list[Case]]
) -> dict[str, Any]:
    """The trial in the child: make examples of toy cases, and fit.

    Parameters
    ----------
    asked : ``folder`` for the weights (none: they are discarded), ``resume``: whether to interrupt half-way
    toys : function from a task to a few cases of it
    """
    trained_by = getattr(plugin.cls, "trained_by", None)
    names = [f.name for f in plugin.fields]
    if not isinstance(trained_by, tuple) or not set(trained_by) <= set(names):
        raise UsageError(f"trained_by: expected a tuple of names of parameters, got {trained_by!r}")
    method = build(plugin, asked["values"])
    task = next(t for t in registry().names("task") if plugin.solves(t))
    cases = toys(registry().find("task", task).cls())
    if not cases:
        raise UsageError(f"task {task} has no toy(), which makes a small case; try the method in a run")
    data = TrainingData(
        lambda: map(_recipe, cases),
        sensor=lambda item: named("sensor", item, "TrainingData.sense").build(),
        count=len(cases),
    )
    examples = {name: np.asarray(a) for name, a in method.examples(data, Run(threads=spec["threads"])).items()}
    if not examples:
        raise InvalidOutput("examples(data, run) returned no arrays")

    def fit(end: int, begun: _Counted | None = None) -> tuple[dict[str, np.ndarray], _Counted]:
        run = _Counted(threads=spec["threads"], resumed=begun.stored if begun else None)
        run.end, run.steps = end, begun.steps if begun else 0
        made = build(plugin, asked["values"]).fit(examples, run)
        return {name: np.asarray(array) for name, array in made.items()}, run

    weights, run = fit(STEPS, fit(STEPS // 2)[1] if asked["resume"] else None)
    for name, array in weights.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise InvalidOutput(f"the weights {name!r} are not finite")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(asked["folder"] or folder) / "weights.safetensors"
        path.write_bytes(as_bytes(weights, {"method": plugin.name}))
        back = load(path)
    if digest_arrays(back) != digest_arrays(weights):
        raise InvalidOutput("the weights do not survive a safetensors file; use arrays of float32 or integers")
    size = sum(array.nbytes for array in examples.values()) / 1e6
    count = sum(array.size for array in weights.values())
    return {
        "output": f"{len(cases)} toy cases, {size:.2g} MB of examples, {count:,} numbers",
        "digest": digest_arrays(weights),
        "checkpoints": int(run.stored is not None),
    }


def _recipe(case: Case) -> CaseRecipe:
    return CaseRecipe(case.id, lambda: case)
