"""Meshes of fewer faces, and the distance between two meshes: the error of simplification."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .mesh_surface import MeshSurface
from .plain_mesh import plain_mesh
from .used import used_vertices

if TYPE_CHECKING:
    from trimesh import Trimesh

SAMPLES = 50_000  # points of each surface that its distance to the other is measured at, besides the vertices


class MeshDistance(NamedTuple):
    """How far two surfaces are from each other, both ways, in the unit of their coordinates."""

    rms: float
    """root mean square over points that are uniform by area on both"""
    largest: float
    """the largest distance of those points and of all vertices: a lower bound of the Hausdorff distance"""
    diagonal: float
    """of the bounding box of the first mesh, to hold the distances against"""

    def __str__(self) -> str:
        rms, largest = (f"{d:.3g} ({100 * d / self.diagonal:.2g} % of the diagonal)" for d in (self.rms, self.largest))
        return f"rms {rms}, max {largest}"


def simplify(mesh: Trimesh, faces: int) -> Trimesh:
    """The mesh with at most ``faces`` faces, by quadric error metrics (Garland and Heckbert 1997), from Open3D.

    Edges are contracted in the order of the error that this costs; boundaries are kept in place. A mesh that has as few
    faces is returned as it is. Where there are too few faces for all pieces of a mesh, small pieces vanish.

    Parameters
    ----------
    mesh : Trimesh
    faces : int, at least 4
    """
    import open3d as o3d

    if len(mesh.faces) <= faces:
        return mesh
    # Around the origin and about 1 large: quadrics square the coordinates.
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    used = used_vertices(mesh)
    low, size = used.min(axis=0), float(np.ptp(used, axis=0).max())
    center = low + np.ptp(used, axis=0) / 2
    made = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector((vertices - center) / size), o3d.utility.Vector3iVector(np.asarray(mesh.faces))
    )
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        made = made.simplify_quadric_decimation(faces)
        made.remove_degenerate_triangles()
        made.remove_unreferenced_vertices()
    return plain_mesh(np.asarray(made.vertices) * size + center, np.asarray(made.triangles))


def mesh_distance(mesh: Trimesh, other: Trimesh, rng: np.random.Generator) -> MeshDistance:
    """The distance between two meshes with an area."""
    surfaces = MeshSurface(mesh), MeshSurface(other)
    squares, largest = [], 0.0
    for surface, target in (surfaces, surfaces[::-1]):
        samples, _ = surface.sample(SAMPLES, rng)
        distance = target.project(samples).distance
        at_vertices = target.project(used_vertices(surface.mesh)).distance
        squares.append(float(np.mean(distance**2)))
        largest = max(largest, float(distance.max()), float(at_vertices.max()))
    diagonal = float(np.linalg.norm(np.ptp(used_vertices(mesh), axis=0)))
    return MeshDistance(float(np.sqrt(np.mean(squares))), largest, diagonal)
