"""A task that the bench does not have: pairs of shapes. Its dataset, method and metric come in the same file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import ClassVar

import numpy as np

from bench import Case, CaseRecipe, InvalidOutput, Run, Shape, Task, UsageError, register


@register("task")
@dataclass(frozen=True)
class Morph(Task):
    """A source mesh and a target mesh -> the source mesh with new vertices."""

    output: ClassVar[str] = "mesh"
    needs_sensor: ClassVar[bool] = False  # its input is made of the shapes themselves
    promise: ClassVar[str] = "the source mesh with new vertices, all finite"

    def recipes(self, dataset, sensor, *, split: str, count: int, seed: int) -> Iterator[CaseRecipe]:
        if not hasattr(dataset, "pairs"):
            raise UsageError(f"task morph: the dataset {type(dataset).__name__} has no pairs(split)")
        for source, target in islice(dataset.pairs(split), count):
            yield CaseRecipe(f"{source.id}-to-{target.id}", lambda pair=(source, target): self._pair(*pair, seed))

    def _pair(self, source: Shape, target: Shape, seed: int) -> Case:
        framed, frame = target.framed()
        given, _ = source.framed()
        name = f"{source.id}-to-{target.id}"
        return Case(name, {"source": given.mesh, "target": framed.mesh}, framed, frame, seed, ("pair",))

    def validate(self, output, input) -> None:
        if not hasattr(output, "vertices") or len(output.vertices) != len(input["source"].vertices):
            raise InvalidOutput(f"promised {self.promise}; got {type(output).__name__}")
        if not np.isfinite(output.vertices).all():
            raise InvalidOutput(f"promised {self.promise}; got NaN")


@register("dataset", requires=("trimesh",))
@dataclass(frozen=True)
class Eggs:
    """Pairs of ellipsoids of 162 vertices, in correspondence."""

    def pairs(self, split: str) -> Iterator[tuple[Shape, Shape]]:
        for index in range(10):
            yield self._egg(index), self._egg(index + 1)

    def _egg(self, index: int) -> Shape:
        return Shape(f"egg-{index}", lambda: self._mesh(1 + 0.1 * index), info={"index": index})

    def _mesh(self, stretch: float):
        from trimesh.creation import icosphere

        mesh = icosphere(subdivisions=2)
        mesh.vertices *= (1, 1, stretch)
        return mesh


@register("method")
@dataclass(frozen=True)
class Stay:
    """The source as it is."""

    def morph(self, source, target, run: Run):
        return source.copy()


@register("method")
@dataclass(frozen=True)
class Follow:
    """The source with the target's vertices, or a part of the way there."""

    part: float = 1.0  # 0 stays, 1 arrives

    def morph(self, source, target, run: Run):
        moved = source.copy()
        moved.vertices = (1 - self.part) * source.vertices + self.part * target.vertices
        return moved


@register("metric", version=1, better="lower", outputs=("mesh",), floor=True)
@dataclass(frozen=True)
class VertexDistance:
    """Mean distance of corresponding vertices."""

    def score(self, output, case: Case) -> dict[str, float]:
        return {"vertex_distance": float(np.linalg.norm(output.vertices - case.reference.mesh.vertices, axis=1).mean())}
