"""Outliers in clumps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Effect, PointCloud, Shape, register

from .checks import expect_count, expect_fraction, expect_length
from .spoiling import inflated_box, replaced, some_of

LONGEST = 10.0  # factor at which the tails of a cluster are truncated


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class OutliersClustered(Effect):
    """Moves a share of the points into a few clumps, dense enough to look like surfaces to a filter.

    Around each centre the points have Student's t distribution with two degrees of freedom: a dense core with heavy
    tails. The offset of a point is ``size * g / sqrt(w)``, g a Gaussian vector and w exponential, truncated where
    ``1 / sqrt(w)`` exceeds 10. Normals point in random directions.
    """

    fraction: float = 0.1  # of the points that become outliers; below 1
    clusters: int = 10  # clumps, anywhere in the bounding box
    size: float = 0.03  # of a clump's core in each of x, y and z, relative to the bounding-sphere radius
    inflation: float = 0.1  # by how much the sides of the box of the centres are longer than the shape's

    def __post_init__(self) -> None:
        expect_fraction("fraction", self.fraction)
        expect_count("clusters", self.clusters)
        expect_length("size", self.size)
        expect_length("inflation", self.inflation)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """As many points as before."""
        lost = some_of(cloud, self.fraction, rng)
        centers = rng.uniform(*inflated_box(shape, self.inflation), size=(self.clusters, 3))
        cluster = rng.integers(self.clusters, size=len(lost))
        # The exponential has no memory: shifted by a bound, it is the exponential above that bound.
        w = LONGEST**-2 + rng.exponential(size=(len(lost), 1))
        offsets = self.size * rng.normal(size=(len(lost), 3)) / np.sqrt(w)
        return replaced(cloud, lost, centers[cluster] + offsets, rng)
