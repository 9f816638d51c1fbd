"""A mesh with its own copies of vertices and faces, and nothing merged or removed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from trimesh import Trimesh


def plain_mesh(vertices: np.ndarray, faces: np.ndarray) -> Trimesh:
    """The mesh of vertices (v, 3) and faces (f, 3) as they are: numbers and order stay."""
    from trimesh import Trimesh

    return Trimesh(np.array(vertices), np.array(faces), process=False)
