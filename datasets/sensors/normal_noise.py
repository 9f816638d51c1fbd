"""Noise along the normal of the surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import Effect, PointCloud, Shape, register

from .checks import expect_choice, expect_length
from .spoiling import UNITS, in_units, moved


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class NormalNoise(Effect):
    """Gaussian noise along the exact normal of the surface: the points stay evenly spread along the surface.

    The normal is the surface's at the closest point, whatever normals the cloud has.
    """

    sigma: float = 0.01  # standard deviation along the normal, in the unit below
    unit: Literal["radius", "diagonal"] = "radius"  # of sigma: bounding-sphere radius, or diagonal of the box

    def __post_init__(self) -> None:
        expect_length("sigma", self.sigma)
        expect_choice("unit", self.unit, UNITS)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """Every point moves."""
        _, normals = shape.surface.closest(cloud.points)
        heights = in_units(self.sigma, self.unit, shape) * rng.normal(size=(len(cloud), 1))
        return moved(cloud, cloud.points + heights * normals)
