"""Initial cages."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from trimesh import Trimesh

RADIUS = 2.0  # of the template's corners, for a shape in the box from -1 to 1


def sphere_cage(radius: float = RADIUS) -> tuple[np.ndarray, np.ndarray]:
    """The template of Neural Cages: an icosahedron with the midpoints of its edges, which lie on its flat faces.

    Returns
    -------
    vertices : (42, 3) array
        The twelve corners are ``radius`` from the origin, the other thirty 0.8507 of it.
    faces : (80, 3) array, outward
    """
    from trimesh.creation import icosahedron

    from bench.geometry.subdivision import divided

    solid = icosahedron()
    corners = solid.vertices / np.linalg.norm(solid.vertices, axis=1, keepdims=True)
    return divided(radius * corners, solid.faces, 1)


def ball_cage(subdivisions: int = 1, radius: float = 1.2) -> tuple[np.ndarray, np.ndarray]:
    """A round cage: 12, 42, 162, ... vertices at ``radius`` from the origin, and its faces, outward."""
    from trimesh.creation import icosphere

    ball = icosphere(subdivisions=subdivisions, radius=radius)
    return np.array(ball.vertices), np.array(ball.faces)


def cage_mesh(vertices: np.ndarray, faces: np.ndarray) -> Trimesh:
    """A cage as a mesh for storage."""
    from trimesh import Trimesh

    return Trimesh(vertices, faces, process=False)
