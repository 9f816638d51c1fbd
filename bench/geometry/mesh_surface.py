"""A triangle mesh as a :class:`bench.Surface`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .sampling import face_normals, sample_uniform

if TYPE_CHECKING:
    from trimesh import Trimesh


class MeshSurface:
    """The mesh itself is the truth: uniform samples with face normals, exact closest points."""

    def __init__(self, mesh: Trimesh):
        self.mesh = mesh
        self._normals: np.ndarray | None = None

    @property
    def normals(self) -> np.ndarray:
        """(f, 3) unit face normals."""
        if self._normals is None:
            self._normals = face_normals(self.mesh)
        return self._normals

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``count`` points uniform by area, and their face normals."""
        points, faces = sample_uniform(self.mesh, count, rng)
        return points, self.normals[faces]

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The closest point of the mesh to each of ``points``, in float64 (libigl), and the normal of its face."""
        import igl

        faces = np.ascontiguousarray(self.mesh.faces, dtype=np.int64)
        vertices = np.ascontiguousarray(self.mesh.vertices, dtype=np.float64)
        queries = np.ascontiguousarray(points, dtype=np.float64)
        _, face, closest = igl.point_mesh_squared_distance(queries, vertices, faces)
        return closest, self.normals[face]
