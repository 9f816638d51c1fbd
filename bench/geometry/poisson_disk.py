"""Evenly spread points on a surface, in an exact number."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import BadInput

if TYPE_CHECKING:
    from trimesh import Trimesh

    from ..contract.shape import Shape

CANDIDATES = 5  # uniform samples for each point that the elimination keeps (Yuksel 2015)


def sample_poisson_disk(shape: Shape, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Exactly ``count`` evenly spread points of the exact surface of a shape, and their unit normals.

    Sample elimination (Yuksel 2015): of five times as many independent uniform samples, one of the most crowded is
    removed repeatedly. The mesh's area determines how far apart they can be; a surface for which it does not, such
    as curves on a thin ribbon, has a function ``sample_evenly(count, rng)`` and is asked for the points.

    Parameters
    ----------
    shape : Shape
    count : int, >= 1
    rng : numpy Generator

    Returns
    -------
    points, normals : (count, 3) arrays

    Raises
    ------
    BadInput
        If only points are known of the shape.
    """
    evenly = getattr(shape.surface, "sample_evenly", None)
    if evenly is not None:
        return evenly(count, rng)
    if count == 1:
        return shape.surface.sample(count, rng)
    if shape.cloud is not None:
        raise BadInput(
            f"{shape.id}: only points of this shape are known, and evenly spread points need its surface; "
            "sensor=uniform takes some of the points that are known"
        )
    return eliminate(*shape.surface.sample(CANDIDATES * count, rng), shape.mesh, count)


def eliminate(points: np.ndarray, normals: np.ndarray, mesh: Trimesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The ``count`` of ``points`` (n, 3) and ``normals`` that remain when the most crowded are taken away.

    Deterministic: open3d draws random numbers only where it makes the candidates itself. It asks the mesh for its area.
    """
    from open3d.geometry import PointCloud as Cloud
    from open3d.geometry import TriangleMesh
    from open3d.utility import Vector3dVector, Vector3iVector

    cloud = Cloud(Vector3dVector(points))
    cloud.normals = Vector3dVector(normals)
    surface = TriangleMesh(Vector3dVector(mesh.vertices), Vector3iVector(mesh.faces))
    kept = surface.sample_points_poisson_disk(count, pcl=cloud)
    return np.array(kept.points), np.array(kept.normals)
