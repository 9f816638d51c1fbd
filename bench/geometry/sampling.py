"""Random points on a mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from trimesh import Trimesh


def sample_uniform(mesh: Trimesh, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points on a mesh, uniform by area.

    Parameters
    ----------
    mesh : Trimesh of f faces, with an area
    count : int
    rng : numpy Generator

    Returns
    -------
    points : (count, 3) float64 array
    faces : (count,) int array
        The face of each point. The cost is O(f + count log f).
    """
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    cumulative = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    faces = np.searchsorted(cumulative, rng.random(count) * cumulative[-1], side="right")
    np.minimum(faces, len(cumulative) - 1, out=faces)
    # Folding the unit square along its diagonal gives barycentric coordinates that are uniform on the triangle.
    u, v = rng.random((2, count, 1))
    folded = u + v > 1
    u, v = np.where(folded, 1 - u, u), np.where(folded, 1 - v, v)
    return a[faces] + u * (b[faces] - a[faces]) + v * (c[faces] - a[faces]), faces


def face_normals(mesh: Trimesh) -> np.ndarray:
    """(f, 3) unit normals by the right-hand rule; zero for faces without an area."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
