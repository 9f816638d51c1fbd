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


class MeshSurface:
    """The mesh itself is the truth: uniform samples with face normals, exact closest points.

    Faces without an area are no part of the surface: they have no normal, and no sample falls on them.
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
