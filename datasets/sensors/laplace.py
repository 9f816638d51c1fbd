"""Laplace noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import Effect, PointCloud, Shape, register

from .checks import expect_choice, expect_length
from .spoiling import UNITS, in_units, moved


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class Laplace(Effect):
    """Independent Laplace noise in x, y and z: most points hardly move, some move far (excess kurtosis 3).

    The parameter is the standard deviation, so that levels are comparable with ``gaussian``; the scale of the
    distribution is sigma / sqrt(2).
    """

    sigma: float = 0.01  # standard deviation in each of x, y and z, in the unit below
    unit: Literal["radius", "diagonal"] = "radius"  # of sigma: bounding-sphere radius, or diagonal of the box

    def __post_init__(self) -> None:
        expect_length("sigma", self.sigma)
        expect_choice("unit", self.unit, UNITS)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """Every point moves."""
        scale = in_units(self.sigma, self.unit, shape) / np.sqrt(2)
        return moved(cloud, cloud.points + rng.laplace(scale=scale, size=cloud.points.shape))
