"""A triangle mesh as a :class:`bench.Surface`."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .closest import Closest, TriangleTree
from .neighbours import OrderedPoints
from .sampling import face_normals, sample_uniform

if TYPE_CHECKING:
    from trimesh import Trimesh

CREASE = np.cos(np.radians(30))  # a normal that differs more from its face's belongs to another side of an edge


class MeshSurface:
    """The mesh itself is the truth: uniform samples with face normals, exact closest points.

    Faces without an area are not part of the surface: they have no normal, and no sample falls on them.
    """

    def __init__(self, mesh: Trimesh):
        self.mesh = mesh

    @cached_property
    def normals(self) -> np.ndarray:
        """(f, 3) unit face normals; zero for faces without an area."""
        return face_normals(self.mesh)

    @cached_property
    def _tree(self) -> tuple[TriangleTree, np.ndarray]:
        """The tree over the faces with an area, and their indices."""
        faces = np.flatnonzero(self.normals.any(axis=1))
        if not len(faces):  # a mesh without any area is still at some distance
            faces = np.arange(len(self.mesh.faces))
        return TriangleTree(self.mesh.vertices, self.mesh.faces[faces]), faces

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``count`` points uniform by area, and their face normals."""
        points, faces = sample_uniform(self.mesh, count, rng)
        return points, self.normals[faces]

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The closest point of the mesh to each of ``points``, in float64, and the normal of its face."""
        found = self.project(points)
        return found.points, self.normals[found.faces]

    def project(self, points: np.ndarray | OrderedPoints) -> Closest:
        """The closest point of the mesh to each of ``points`` (n, 3), with its distance and its face."""
        tree, faces = self._tree
        found = tree.closest(points)
        return found._replace(faces=faces[found.faces])

    def interpolate_normals(self, vertex_normals: np.ndarray, at: Closest) -> np.ndarray:
        """Unit normals at points of the mesh, between normals (v, 3) that are known at its vertices: an (n, 3) array.

        A vertex on a crease has the normal of one of its sides; in faces of the other side, the face's own is taken.
        """
        face_normals, corners = self.normals[at.faces], np.asarray(self.mesh.faces)[at.faces]
        normals = np.zeros_like(at.points)
        for k, weight in enumerate(barycentric(at.points, np.asarray(self.mesh.vertices), corners)):
            at_corner = vertex_normals[corners[:, k]]
            same_side = np.einsum("ni,ni->n", at_corner, face_normals) > CREASE
            normals += weight[:, None] * np.where(same_side[:, None], at_corner, face_normals)
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def barycentric(points: np.ndarray, V: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The weights of the corners of ``triangles`` (n, 3) at ``points`` (n, 3) in them: three (n,) arrays in 0..1."""
    a, b, c = (V[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    area = np.einsum("ni,ni->n", normal, normal)
    # Each weight is the share of the area that the point spans with the opposite edge.
    u = np.clip(np.einsum("ni,ni->n", np.cross(b - points, c - points), normal) / area, 0, 1)
    v = np.clip(np.einsum("ni,ni->n", np.cross(c - points, a - points), normal) / area, 0, 1 - u)
    return u, v, 1 - u - v
