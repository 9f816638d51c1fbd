"""Independent uniform samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Shape, register

from .checks import expect_count


@register("sensor")
@dataclass(frozen=True)
class Uniform:
    """Independent points of the exact surface, uniform by area, with the exact normals."""

    count: int = 5000  # points, exactly

    def __post_init__(self) -> None:
        expect_count("count", self.count)

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """A cloud of exactly ``count`` points."""
        return PointCloud(*shape.surface.sample(self.count, rng))
