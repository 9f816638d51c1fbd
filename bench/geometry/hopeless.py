"""Outputs that ignore their input: those of the pseudo-methods, by which a failed case is scored."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .cloud import PointCloud
from .tiny_triangles import triangles_around

if TYPE_CHECKING:
    from trimesh import Trimesh

SIZE = 0.001  # of the triangles that stand for points in a mesh, in the unit of the frame


def random_cloud(count: int, rng: np.random.Generator) -> PointCloud:
    """``count`` points uniform in the unit ball, with unit normals at random."""
    points = _in_ball(count, rng)
    return PointCloud(points, _directions(count, rng))


def random_triangles(count: int, rng: np.random.Generator, size: float = SIZE) -> Trimesh:
    """``count`` tiny triangles with centroids uniform in the unit ball, turned at random.

    ``size`` is the distance of their corners from the centroid.
    """
    points = _in_ball(count, rng)
    return triangles_around(points, _directions(count, rng), size)


def no_points() -> PointCloud:
    """A cloud of no points; it has normals, of which there are none."""
    return PointCloud(np.empty((0, 3)), np.empty((0, 3)))


def no_faces() -> Trimesh:
    """A mesh without vertices and faces."""
    from trimesh import Trimesh

    return Trimesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64), process=False)


def _in_ball(count: int, rng: np.random.Generator) -> np.ndarray:
    # The volume within radius r grows with its cube.
    return _directions(count, rng) * np.cbrt(rng.random((count, 1)))


def _directions(count: int, rng: np.random.Generator) -> np.ndarray:
    directions = rng.standard_normal((count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)
