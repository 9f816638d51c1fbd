"""Evenly spread samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Shape, register
from bench.geometry.poisson_disk import sample_poisson_disk

from .checks import expect_count


@register("sensor", requires=("open3d",), cite="Sample elimination: Yuksel 2015")
@dataclass(frozen=True)
class PoissonDisk:
    """An exact number of evenly spread points of the exact surface, with the exact normals."""

    count: int = 5000  # points, exactly

    def __post_init__(self) -> None:
        expect_count("count", self.count)

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """A cloud of exactly ``count`` points."""
        return PointCloud(*sample_poisson_disk(shape, self.count, rng))
