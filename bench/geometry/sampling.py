"""Random points on a mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from trimesh import Trimesh


def sample_uniform(mesh: Trimesh, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points on a mesh, uniform by area, independent, in random order.

    Parameters
    ----------
    mesh : Trimesh of f faces, with an area
    count : int
    rng : numpy Generator

    Returns
    -------
    points : (count, 3) float64 array
    faces : (count,) int array
        The face of each point, never one without an area. The cost is O(f + count log count).
    """
    cumulative = np.cumsum(np.linalg.norm(_area_vectors(mesh), axis=1))
    # Sorted numbers walk through the faces once; in random order each search would miss the cache.
    heights = np.sort(rng.random(count)) * cumulative[-1]
    last = int(np.searchsorted(cumulative, cumulative[-1]))  # rounding must not reach flat faces at the end
    faces = np.minimum(np.searchsorted(cumulative, heights, side="right"), last)
    # Folding the unit square along its diagonal gives barycentric coordinates that are uniform on the triangle.
    u, v = rng.random((2, count, 1))
    folded = u + v > 1
    u, v = np.where(folded, 1 - u, u), np.where(folded, 1 - v, v)
    a, b, c = _corners(mesh, faces)
    points = a + u * (b - a) + v * (c - a)
    shuffled = rng.permutation(count)
    return points[shuffled], faces[shuffled]


def face_normals(mesh: Trimesh) -> np.ndarray:
    """(f, 3) unit normals by the right-hand rule; zero for faces without an area."""
    normals = _area_vectors(mesh)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)


def _area_vectors(mesh: Trimesh) -> np.ndarray:
    """(f, 3) array: twice the area of each face, along its normal."""
    a, b, c = _corners(mesh)
    return np.cross(b - a, c - a)


def _corners(mesh: Trimesh, faces: np.ndarray | slice = slice(None)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The first, second and third corners of the given faces: three (n, 3) arrays."""
    vertices, indices = np.asarray(mesh.vertices), np.asarray(mesh.faces)[faces]  # without trimesh's tracking
    return vertices[indices[:, 0]], vertices[indices[:, 1]], vertices[indices[:, 2]]
