"""Closest points on a triangle mesh, exact, in float64 (libigl's bounding-box tree).

Other libraries answer faster in float32, but name another triangle if two are nearly as close, with a distance
error around 1e-7 that no later correction of the named triangle removes. Queries that follow a space-filling curve
(:mod:`bench.geometry.neighbours`) make libigl as fast as they are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .neighbours import OrderedPoints


class Closest(NamedTuple):
    """The closest point of a mesh to each of n points."""

    distance: np.ndarray
    """(n,) float64 array, Euclidean"""
    points: np.ndarray
    """(n, 3) float64 array, on the mesh"""
    faces: np.ndarray
    """(n,) int array: a face that contains the closest point"""


class TriangleTree:
    """A bounding-box tree over the triangles of a mesh, for many queries.

    Parameters
    ----------
    vertices : (v, 3) float64 array
    faces : (f, 3) int array, f >= 1
        Faces without an area count as the segments or points that they are.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        import igl

        self._vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self._faces = np.ascontiguousarray(faces, dtype=np.int64)
        self._tree = igl.AABB()
        self._tree.init(self._vertices, self._faces)

    def closest(self, points: np.ndarray | OrderedPoints) -> Closest:
        """The closest point of the mesh to each of ``points`` (n, 3)."""
        queries = points if isinstance(points, OrderedPoints) else OrderedPoints(np.asarray(points, dtype=np.float64))
        if not len(queries):
            return Closest(np.empty(0), np.empty((0, 3)), np.empty(0, dtype=np.int64))
        squared, faces, closest = self._tree.squared_distance(self._vertices, self._faces, queries.along_curve)
        return Closest(np.sqrt(queries.restore(squared)), queries.restore(closest), queries.restore(faces))
