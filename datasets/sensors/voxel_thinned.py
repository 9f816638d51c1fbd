"""Dense samples, thinned by a voxel grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Shape, register
from bench.geometry.used import used_vertices

from .checks import expect, expect_count


@register("sensor")
@dataclass(frozen=True)
class VoxelThinned:
    """One point for each voxel that the surface passes through, as most scanning software returns.

    Dense independent samples are reduced to one random sample in each voxel. The number of points depends on the
    shape: about 1.4 times its area divided by the square of the voxel size, some thousands at the default. The pattern
    of the grid is visible in the cloud. The grid starts at a random offset.
    """

    voxel: float = 0.05  # side of a voxel, relative to the bounding-sphere radius
    dense: int = 100_000  # number of samples before the thinning; too few for the voxel size leave holes

    def __post_init__(self) -> None:
        expect(0.002 <= self.voxel <= 2, "voxel", "0.002 to 2", self.voxel)
        expect_count("dense", self.dense)

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """A cloud of one sample in each voxel."""
        points, normals = shape.surface.sample(self.dense, rng)  # in random order: the first in a voxel is any of them
        corner = used_vertices(shape.mesh).min(axis=0) - self.voxel * (1 + rng.random(3))
        i, j, k = np.floor((points - corner) / self.voxel).astype(np.int64).T
        span = int(max(j.max(), k.max())) + 1
        _, first = np.unique((i * span + j) * span + k, return_index=True)
        first = np.sort(first)
        return PointCloud(points[first], normals[first])
