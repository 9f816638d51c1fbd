"""Normals from few neighbours: rough, but without smoothing before the network."""

from __future__ import annotations

import numpy as np

from bench import PointCloud
from bench.geometry.normals import estimate_normals, with_normals


def with_rough_normals(cloud: PointCloud, neighbours: int) -> PointCloud:
    """The points with normals of planes through ``neighbours`` points, on the side of their previous normals.

    Parameters
    ----------
    cloud : PointCloud
        Normals are estimated and oriented if it has none.
    neighbours : int
        The point itself included; 0 keeps the normals.
    """
    oriented = with_normals(cloud)
    if not neighbours:
        return oriented
    assert oriented.normals is not None
    normals = estimate_normals(cloud.points, min(neighbours, len(cloud))).normals
    inward = np.einsum("ni,ni->n", normals, oriented.normals) < 0
    return PointCloud(cloud.points, np.where(inward[:, None], -normals, normals), cloud.colors)
