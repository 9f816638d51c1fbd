"""Advancing front surface reconstruction, by CGAL."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import BadInput, PointCloud, Run, register

from .front import advancing_front
from .inputs import ROUNDING, distinct_oriented, in_plane
from .isolated import without_isolated

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", cite="Cohen-Steiner and Da 2004", requires=("CGAL", "scipy", "trimesh"))
@dataclass(frozen=True)
class AdvancingFront:
    """Advancing front: Delaunay triangles are added one by one, the most plausible first.

    A manifold mesh through points of the input, as noisy as they are, that adapts to any sampling density. The
    triangles are chosen without normals, which only determine the outward side. Above about 50,000 points the time
    grows faster than their number: 4 s for 20,000, 90 s for 100,000.
    """

    radius_ratio: float = 5.0  # how much larger than its neighbour a triangle's circle may be; larger closes more
    beta: float = 0.52  # radians that a dihedral angle may deviate from flat before plausibility drops

    def __post_init__(self) -> None:
        if not self.radius_ratio > 0:
            raise ValueError(f"radius_ratio: expected a number above 0, got {self.radius_ratio}")
        if not 0 < self.beta < np.pi:
            raise ValueError(f"beta: expected radians above 0 and below pi, got {self.beta}")

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A manifold mesh, outward; holes with plausible lids are closed, wide openings stay."""
        from trimesh import Trimesh

        cloud, _ = without_isolated(cloud, "advancing_front", run)
        points, normals, _ = distinct_oriented(cloud, "advancing_front", at_least=4)
        vertices, faces = self._front(points)
        if not len(faces):
            raise BadInput(f"advancing_front: found no plausible triangle in {len(points)} points; expected a surface")
        return Trimesh(*in_order(vertices, turn_pieces(vertices, faces, points, normals)), process=False)

    def _front(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The vertices (v, 3), all of them among the points (n, 3), and triangles (f, 3) of the front."""
        from scipy.spatial import cKDTree

        from bench.geometry.spacing import mean_spacing

        plane = in_plane(points, ROUNDING * mean_spacing(points))
        if plane is None:
            return advancing_front(points, self.radius_ratio, self.beta)
        level = np.column_stack([plane, np.zeros(len(plane))])
        vertices, faces = advancing_front(level, self.radius_ratio, self.beta)
        return points[cKDTree(level).query(vertices)[1]] if len(vertices) else vertices, faces


def in_order(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same mesh with its vertices (v, 3) and faces (f, 3) sorted: CGAL's order differs from call to call."""
    order = np.lexsort(vertices.T)
    faces = np.argsort(order, kind="stable")[faces]
    first = faces.argmin(axis=1)[:, None]
    faces = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    return vertices[order], faces[np.lexsort(faces.T)]


def turn_pieces(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The faces, flipped so that every connected component agrees with the normals of its points.

    Parameters
    ----------
    vertices : (v, 3) array, all of them among the points
    faces : (f, 3) int array, consistent within each component
    points, normals : (n, 3) arrays

    Returns
    -------
    (f, 3) int array
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    a, b, c = (vertices[faces[:, k]] for k in range(3))
    wanted = normals[cKDTree(points).query(vertices)[1]][faces].sum(axis=1)
    votes = np.einsum("ni,ni->n", np.cross(b - a, c - a), wanted)
    ends = np.roll(faces, -1, axis=1).ravel()
    graph = coo_array((np.ones(faces.size), (faces.ravel(), ends)), shape=(len(vertices), len(vertices)))
    piece = connected_components(graph, directed=False)[1][faces[:, 0]]
    wrong = np.bincount(piece, votes)[piece] < 0
    return np.where(wrong[:, None], faces[:, ::-1], faces)
