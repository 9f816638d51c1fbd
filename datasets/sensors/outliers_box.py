"""Outliers anywhere in the bounding box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Effect, PointCloud, Shape, register

from .checks import expect_fraction, expect_length
from .spoiling import inflated_box, replaced, some_of


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class OutliersBox(Effect):
    """Moves a share of the points to random places in the bounding box, with normals in random directions."""

    fraction: float = 0.1  # of the points that become outliers; below 1
    inflation: float = 0.1  # by how much the sides of the box are longer than the shape's

    def __post_init__(self) -> None:
        expect_fraction("fraction", self.fraction)
        expect_length("inflation", self.inflation)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """As many points as before."""
        lost = some_of(cloud, self.fraction, rng)
        low, high = inflated_box(shape, self.inflation)
        return replaced(cloud, lost, rng.uniform(low, high, size=(len(lost), 3)), rng)
