"""Plugins for tests of what a worker reports: shapes of given names, a method and a metric that do as told."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bench import PointCloud, Run, Shape, register
from bench.errors import BadInput
from bench.geometry.comparison import NeedsSurface
from bench.notices import notice

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("dataset", requires=("trimesh",))
@dataclass(frozen=True)
class Named:
    """Spheres of given names."""

    ids: list[str] = field(default_factory=list)
    clouds: bool = False  # whether only their vertices are known

    def shapes(self, split: str) -> Iterator[Shape]:
        from trimesh.creation import icosphere

        for name in self.ids:
            mesh = icosphere(subdivisions=1)
            made = PointCloud(mesh.vertices, mesh.vertex_normals) if self.clouds else mesh
            yield Shape(name, made, tags=("round",))


@register("method")
@dataclass(frozen=True)
class Told:
    """Keeps the cloud, after it did as told."""

    do: str = ""

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        if self.do == "fork":
            if not (child := os.fork()):
                raise ArithmeticError("a mistake in a process of its own")
            run.note(f"ended with {os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])}")
        if self.do == "trace":
            run.trace(PointCloud(cloud.points[:7]))
            run.note("traced")
        if self.do == "keep":
            run.keep("cage", cloud)
        return cloud

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        from trimesh.creation import icosphere

        return icosphere(subdivisions=1)


@register("metric", version=1, better="lower", requires=("no_such_library_of_a_metric",))
@dataclass(frozen=True)
class Lacking:
    """Cannot be computed."""

    def score(self, output, case) -> dict[str, float]:
        return {}


@register("metric", version=1, better="higher", floor=True)
@dataclass(frozen=True)
class Size:
    """How many points an output has more than the input."""

    least: int = 0  # outputs of fewer points have no score
    refuse: int = 0  # outputs of fewer points
    surface: bool = False  # whether it needs one

    def score(self, output, case) -> dict[str, float]:
        if self.surface:
            raise NeedsSurface("no surface")
        count = len(output.points if isinstance(output, PointCloud) else output.vertices)
        if count < self.refuse:
            raise BadInput(f"an output of {count} points")
        if count < self.least:
            notice("it is small")
            return {}
        return {"size": float(count - len(case.input["cloud"]))}

    def why_not(self, output, case) -> str:
        return f"only {len(output)} points"
