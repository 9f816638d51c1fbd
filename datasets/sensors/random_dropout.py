"""Points lost at random."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Effect, PointCloud, Shape, register

from .checks import expect_fraction
from .spoiling import kept, some_of


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class RandomDropout(Effect):
    """Removes a random share of the points."""

    fraction: float = 0.5  # of the points that are removed; below 1

    def __post_init__(self) -> None:
        expect_fraction("fraction", self.fraction)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """The points that are left, in their order; their number is exact."""
        mask = np.ones(len(cloud), dtype=bool)
        mask[some_of(cloud, self.fraction, rng)] = False
        return kept(cloud, mask, shape, "random_dropout")
