"""Deformation gradients of triangles, and corresponding triangles of two meshes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from trimesh import Trimesh

LOOKED_AT = 24  # nearest triangles among which those with agreeing normals are chosen


def deformation_gradients(before: np.ndarray, after: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The matrices (f, 3, 3) that map a triangle's edges, and its normal, to those after (Sumner and Popović 2004).

    The length of the normal is the square root of twice the area, so that it scales with the edges. Triangles without
    area get the identity.

    Parameters
    ----------
    before, after : (v, 3) arrays
    faces : (f, 3) int array
    """
    rest, moved = _frames(before, faces), _frames(after, faces)
    flat = np.abs(np.linalg.det(rest)) < 1e-30
    rest[flat] = moved[flat] = np.eye(3)
    return moved @ np.linalg.inv(rest)


def _frames(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Two edges and the normal of each face, as the columns of (f, 3, 3)."""
    a, b, c = (np.asarray(vertices, dtype=np.float64)[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, np.sqrt(length), out=np.zeros_like(normal), where=length > 0)
    return np.stack([b - a, c - a, normal], axis=2)


def corresponding_faces(
    template: Trimesh, there: np.ndarray, here: np.ndarray, vertices: np.ndarray, faces: np.ndarray, count: int
) -> np.ndarray:
    """For each face of a character the ``count`` nearest faces of the template with agreeing normals.

    First the thin-plate spline that maps the landmarks ``there`` (l, 3) to ``here`` (l, 3) maps the template onto the
    character. If too few normals agree, the nearest faces are taken with any normals.

    Returns
    -------
    (f, count) int array
    """
    spline = RBFInterpolator(there, here, kernel="thin_plate_spline")
    theirs, their_normals = _centres(spline(np.asarray(template.vertices)), np.asarray(template.faces))
    ours, our_normals = _centres(vertices, faces)
    looked = min(LOOKED_AT * count, len(theirs))
    near = cKDTree(theirs).query(ours, k=np.arange(1, looked + 1))[1]
    agree = np.einsum("fa,fka->fk", our_normals, their_normals[near]) > 0
    first = np.argsort(~agree, axis=1, kind="stable")[:, : min(count, looked)]  # those that agree, by distance
    return np.take_along_axis(near, first, axis=1)


def _centres(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return (a + b + c) / 3, np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
