"""Gaussian noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import Effect, PointCloud, Shape, register

from .checks import expect_choice, expect_length
from .spoiling import UNITS, in_units, moved


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class Gaussian(Effect):
    """Independent Gaussian noise in x, y and z."""

    sigma: float = 0.01  # standard deviation in each of x, y and z, in the unit below
    unit: Literal["radius", "diagonal"] = "radius"  # of sigma: bounding-sphere radius, or diagonal of the box

    def __post_init__(self) -> None:
        expect_length("sigma", self.sigma)
        expect_choice("unit", self.unit, UNITS)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """Every point moves."""
        sigma = in_units(self.sigma, self.unit, shape)
        return moved(cloud, cloud.points + sigma * rng.normal(size=cloud.points.shape))
