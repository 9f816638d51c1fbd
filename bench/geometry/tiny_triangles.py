"""Points as a mesh: one tiny triangle each."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from trimesh import Trimesh


def triangles_around(points: np.ndarray, normals: np.ndarray, size: float) -> Trimesh:
    """Equilateral triangles with their centroids at ``points``, counter-clockwise around ``normals``.

    Parameters
    ----------
    points, normals : (n, 3) arrays, the normals of unit length
    size : float
        Distance of the corners from the centroid.

    Returns
    -------
    Trimesh of 3 n vertices and n faces
    """
    from trimesh import Trimesh

    # The axis along which the normal is shortest is never parallel to it.
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    angles = 2 * np.pi * np.arange(3) / 3
    corners = np.cos(angles)[:, None] * first[:, None] + np.sin(angles)[:, None] * second[:, None]
    vertices = points[:, None] + size * corners
    return Trimesh(vertices.reshape(-1, 3), np.arange(3 * len(points)).reshape(-1, 3), process=False)
