"""A point cloud as a :class:`bench.Surface`: the surface of a reference without a mesh."""

from __future__ import annotations

import numpy as np

from .cloud import PointCloud


class CloudSurface:
    """The points themselves are the truth; there is nothing between them."""

    def __init__(self, cloud: PointCloud):
        self.cloud = cloud

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray | None]:
        """``count`` of the points without repetition, all of them if there are no more, and their normals if any."""
        points, normals = self.cloud.points, self.cloud.normals
        if count >= len(points):
            return points, normals
        some = rng.choice(len(points), count, replace=False)
        return points[some], None if normals is None else normals[some]

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """The nearest of the points, and its normal if it has one."""
        from .neighbours import OrderedPoints

        found = OrderedPoints(np.asarray(points)).nearest_in(OrderedPoints(self.cloud.points)).index
        normals = self.cloud.normals
        return self.cloud.points[found], None if normals is None else normals[found]
