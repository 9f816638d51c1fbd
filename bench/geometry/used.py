"""The vertices that belong to the surface of a mesh: scans and exports hold others, which may lie anywhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from trimesh import Trimesh


def is_used(mesh: Trimesh) -> np.ndarray:
    """(v,) bool array: which vertices are a corner of a face that has an area.

    Where no face has one, the corners of all faces are used; without faces all vertices are, for they are a cloud.
    """
    from .sampling import face_normals

    faces = np.asarray(mesh.faces)
    if not len(faces):
        return np.ones(len(mesh.vertices), dtype=bool)
    sound = face_normals(mesh).any(axis=1)
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[faces[sound] if sound.any() else faces] = True
    return used


def used_vertices(mesh: Trimesh) -> np.ndarray:
    """(n, 3) array: the vertices that :func:`is_used` names, in their order.

    Boxes, frames, means and maxima of a mesh are over these.
    """
    used = is_used(mesh)
    vertices = np.asarray(mesh.vertices)
    return vertices if used.all() else vertices[used]
