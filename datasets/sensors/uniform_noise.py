"""Uniform noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import Effect, PointCloud, Shape, register

from .checks import expect_choice, expect_length
from .spoiling import UNITS, in_units, moved


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class UniformNoise(Effect):
    """Independent noise in x, y and z, uniform between two bounds, so without tails.

    Its standard deviation in each axis is amplitude / sqrt(3). MeshLab's random displacement makes such noise.
    """

    amplitude: float = 0.01  # bound of the noise in each of x, y and z, in the unit below
    unit: Literal["radius", "diagonal"] = "radius"  # of amplitude: bounding-sphere radius, or diagonal of the box

    def __post_init__(self) -> None:
        expect_length("amplitude", self.amplitude)
        expect_choice("unit", self.unit, UNITS)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """Every point moves."""
        amplitude = in_units(self.amplitude, self.unit, shape)
        return moved(cloud, cloud.points + amplitude * rng.uniform(-1, 1, size=cloud.points.shape))
