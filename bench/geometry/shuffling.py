"""Meshes in another order, so that copying by index does not work."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .plain_mesh import plain_mesh

if TYPE_CHECKING:
    from trimesh import Trimesh


def shuffled(mesh: Trimesh, rng: np.random.Generator) -> tuple[Trimesh, np.ndarray, np.ndarray]:
    """The same surface with its vertices and faces in a random order.

    Returns
    -------
    mesh : Trimesh
    order : (v,) int array
        Vertex i is vertex ``order[i]`` of the given mesh.
    faces : (f,) int array
        The same for the faces.
    """
    order, faces = rng.permutation(len(mesh.vertices)), rng.permutation(len(mesh.faces))
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order))
    return plain_mesh(mesh.vertices[order], number[mesh.faces[faces]]), order, faces
