"""Conversions from manifold3d's solids to meshes, shared by several families."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from manifold3d import Manifold
    from trimesh import Trimesh


def arrays(solid: Manifold) -> tuple[np.ndarray, np.ndarray]:
    """The vertices (v, 3) and faces (f, 3) of a solid."""
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties, dtype=np.float64)[:, :3], np.array(mesh.tri_verts, dtype=np.int64)


def origins(solid: Manifold, ids: Sequence[int]) -> np.ndarray:
    """For each face of a union, the index in ``ids`` of the original solid that it comes from (f,)."""
    mesh = solid.to_mesh64()
    labels = np.zeros(len(mesh.tri_verts), dtype=np.int64)
    runs = np.asarray(mesh.run_index, dtype=np.int64) // 3
    for begin, end, number in zip(runs[:-1], runs[1:], mesh.run_original_id, strict=True):
        labels[begin:end] = list(ids).index(int(number))
    return labels


def turned(vertices: np.ndarray, faces: np.ndarray, rotation: np.ndarray) -> Trimesh:
    """The mesh, rotated by ``rotation`` (3, 3)."""
    from trimesh import Trimesh

    # einsum, not a matrix product: the sum is the same to the last bit with every linear algebra library.
    return Trimesh(np.einsum("ij,nj->ni", rotation, vertices), faces, process=False)
