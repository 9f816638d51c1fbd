"""One screened Poisson solve by Open3D, on arrays: the common part of `poisson` and `ipsr`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Solution(NamedTuple):
    """A surface of a Poisson solve; its faces point in the direction of the normals."""

    vertices: np.ndarray  # (v, 3) float64
    faces: np.ndarray  # (f, 3) int
    support: np.ndarray  # (v,) float64: the depth in the octree that the density of points allows there


def solve(
    points: np.ndarray,
    normals: np.ndarray,
    *,
    depth: int,
    scale: float = 1.1,
    samples_per_node: float = 1.5,
    point_weight: float = 2.0,
    linear_fit: bool = False,
) -> Solution:
    """The surface whose indicator function has a gradient that fits the normals (Kazhdan and Hoppe 2013).

    The defaults are those of ``open3d.geometry.TriangleMesh.create_from_point_cloud_poisson`` and of the executable
    that it wraps, except for ``depth``, which is 8 there.

    Parameters
    ----------
    points, normals : (n, 3) float64 arrays, writeable, finite
    depth : int
        Of the octree, 5 to 12.
    scale : float
        Bounding cube of the reconstruction relative to that of the points.
    samples_per_node : float
        Points per octree cell.
    point_weight : float
        The weight of the points in the fit.
    linear_fit : bool
        Whether vertices are set by linear interpolation along the edges of the octree.
    """
    import open3d as o3d

    oriented = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    oriented.normals = o3d.utility.Vector3dVector(normals)
    # "Failed to close loop" and similar messages concern the octree, which the caller cannot change.
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        mesh, support = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            oriented,
            depth=depth,
            scale=scale,
            samples_per_node=samples_per_node,
            point_weight=point_weight,
            linear_fit=linear_fit,
            n_threads=1,  # more change order and last digits from run to run, and are not faster
        )
    return Solution(np.array(mesh.vertices), np.array(mesh.triangles), np.array(support))


def check_octree(depth: int, scale: float, point_weight: float, samples_per_node: float) -> None:
    """Raise ValueError for parameters that the library does not support."""
    # The library fills its octree to level 5; with a smaller depth, it reads nodes that do not exist.
    if not 5 <= depth <= 12:
        raise ValueError(f"depth: expected 5 to 12, got {depth}")
    if not scale >= 1:
        raise ValueError(f"scale: expected at least 1, got {scale}")
    if not point_weight >= 0:
        raise ValueError(f"point_weight: expected at least 0, got {point_weight}")
    if not samples_per_node > 0:
        raise ValueError(f"samples_per_node: expected a number above 0, got {samples_per_node}")
