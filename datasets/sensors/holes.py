"""Round holes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Effect, PointCloud, Shape, register

from .checks import expect_count, expect_length
from .spoiling import kept


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class Holes(Effect):
    """Removes the points in balls around random points of the surface.

    Distances are straight, not along the surface: a hole goes through both sides of a sheet thinner than its radius,
    like the hole that a nearby obstacle leaves in a scan. So thin shapes lose more than round ones: with the defaults
    about 13 % of the points of ``bumps``, 30 % of ``furniture`` and half of ``humanoids``.
    """

    count: int = 8  # number of holes; they may overlap
    radius: float = 0.2  # of each, relative to the bounding-sphere radius

    def __post_init__(self) -> None:
        expect_count("count", self.count, least=0)
        expect_length("radius", self.radius)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """The points outside all holes."""
        if not self.count:
            return cloud
        centers, _ = shape.surface.sample(self.count, rng)
        inside = np.zeros(len(cloud), dtype=bool)
        for center in centers:
            inside |= ((cloud.points - center) ** 2).sum(axis=1) < self.radius**2
        return kept(cloud, ~inside, shape, "holes")
