"""Points that move with a mesh, and the points of a target."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array

from bench import PointCloud
from bench.geometry.check import check_mesh, check_points
from bench.geometry.mesh_surface import MeshSurface

if TYPE_CHECKING:
    from trimesh import Trimesh


class Samples:
    """Points on the faces of a mesh, uniform by area, that keep their barycentric coordinates when its vertices move.

    Parameters
    ----------
    vertices : (n, 3) array
    faces : (f, 3) int array
    count : int
    rng : numpy Generator

    Attributes
    ----------
    matrix : (count, n) sparse array
        Takes vertices to the points.
    faces : (count,) int array
        The face of each point.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator):
        area = np.linalg.norm(_area_vectors(vertices, faces), axis=1)
        # One random shift of evenly spaced numbers, not independent ones: no part gets too few by chance.
        heights = (np.arange(count) + rng.random()) / count * area.sum()
        self.faces = np.minimum(np.searchsorted(np.cumsum(area), heights, side="right"), np.flatnonzero(area)[-1])
        u, v = rng.random((2, count))
        folded = u + v > 1
        u, v = np.where(folded, 1 - u, u), np.where(folded, 1 - v, v)
        self._corners = faces[self.faces]
        rows = np.repeat(np.arange(count), 3)
        entries = (np.column_stack([1 - u - v, u, v]).reshape(-1), (rows, self._corners.reshape(-1)))
        self.matrix = coo_array(entries, shape=(count, len(vertices))).tocsr()

    def normals(self, vertices: np.ndarray) -> np.ndarray:
        """(count, 3) unit normals of the faces of a mesh that moved; zero where a face has collapsed."""
        vectors = _area_vectors(vertices, self._corners)
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)


def _area_vectors(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return np.cross(b - a, c - a)


def points_of(target: Trimesh | PointCloud, count: int, rng: np.random.Generator) -> PointCloud:
    """At most ``count`` points of a cloud, drawn at random, or ``count`` of a mesh with the normals of its faces.

    Raises
    ------
    BadInput
        For an empty target, or one with coordinates that are not finite or all equal.
    """
    if not isinstance(target, PointCloud):
        check_mesh(target, "target")
        return PointCloud(*MeshSurface(target).sample(count, rng))
    check_points(target.points, "target")
    if len(target) <= count:
        return target
    chosen = np.sort(rng.permutation(len(target))[:count])
    return PointCloud(target.points[chosen], None if target.normals is None else target.normals[chosen])
