"""Plugins for tests of what a worker reports: shapes of given names, a method and a metric that do as told."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field

from bench import PointCloud, Run, Shape, register
from bench.errors import BadInput
from bench.geometry.comparison import NeedsSurface


@register("dataset", requires=("trimesh",))
@dataclass(frozen=True)
class Named:
    """Spheres of given names."""

    ids: list[str] = field(default_factory=list)

    def shapes(self, split: str) -> Iterator[Shape]:
        from trimesh.creation import icosphere

        for name in self.ids:
            yield Shape(name, icosphere(subdivisions=1))


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
        return cloud


@register("metric", version=1, better="higher", floor=True)
@dataclass(frozen=True)
class Size:
    """How many points an output has."""

    least: int = 0  # outputs of fewer points have no score
    refuse: int = 0  # outputs of fewer points
    surface: bool = False  # whether it needs one

    def score(self, output, case) -> dict[str, float]:
        if self.surface:
            raise NeedsSurface("no surface")
        if len(output) < self.refuse:
            raise BadInput(f"an output of {len(output)} points")
        return {"size": float(len(output))} if len(output) >= self.least else {}

    def why_not(self, output, case) -> str:
        return f"only {len(output)} points"
