"""A task over pairs whose ids are those of the shapes, with its dataset and method: what a memory must not mix up."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import ClassVar

import numpy as np
from trimesh import Trimesh
from trimesh.creation import icosphere

from bench import Case, CaseRecipe, PointCloud, Run, Shape, ShapePair, Task, register


def ball(*stretch: float) -> Trimesh:
    mesh = icosphere(subdivisions=3)
    return Trimesh(mesh.vertices * (stretch or (1.0, 1.0, 1.0)), mesh.faces, process=False)


@register("dataset")
@dataclass(frozen=True)
class Twins:
    """Balls; a pair of the same id has an egg for its target."""

    def shapes(self, split: str) -> Iterator[Shape]:
        for index in range(4):
            yield Shape(f"twin-{index}", ball)

    def pairs(self, split: str) -> Iterator[ShapePair]:
        for index in range(4):
            egg = ball(0.5, 0.7, 1.0 + index)
            yield ShapePair(f"twin-{index}", Shape(f"twin-{index}", ball), Shape(f"twin-{index}", egg))


@register("sensor")
@dataclass(frozen=True)
class Sparse:
    """Some vertices."""

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud:
        return PointCloud(rng.choice(shape.mesh.vertices, 200))


@register("task")
@dataclass(frozen=True)
class Swap(Task):
    """The source of a pair -> its target."""

    output: ClassVar[str] = "mesh"
    needs_sensor: ClassVar[bool] = False
    promise: ClassVar[str] = "a mesh"

    def recipes(self, dataset, sensor, *, split: str, count: int, seed: int) -> Iterator[CaseRecipe]:
        for pair in islice(dataset.pairs(split), count):
            yield CaseRecipe(pair.id, lambda pair=pair: self._case_of(pair, seed))

    def _case_of(self, pair: ShapePair, seed: int) -> Case:
        reference, frame = pair.target.framed()
        return Case(pair.id, {"source": pair.source.mesh, "target": reference.mesh}, reference, frame, seed)

    def validate(self, output, input) -> None:
        """Whatever it is."""


@register("method")
@dataclass(frozen=True)
class Knows:
    """The exact answer of each task."""

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        return ball()

    def swap(self, source: Trimesh, target: Trimesh, run: Run) -> Trimesh:
        return target.copy()
