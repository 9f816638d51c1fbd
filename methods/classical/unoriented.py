"""The common part of methods that find the normals of a cloud themselves: their points, and the outward side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench import BadInput, PointCloud, Run

from .inputs import distinct_points, note_coarse, note_flat
from .isolated import without_isolated

if TYPE_CHECKING:
    from trimesh import Trimesh

    from .screened_poisson import Solution


def points_for_poisson(cloud: PointCloud, depth: int, scale: float, method: str, run: Run) -> np.ndarray:
    """The distinct points (n, 3) of a cloud, without isolated ones; with notes on the effects on Poisson."""
    cloud, _ = without_isolated(cloud, method, run)
    points, _ = distinct_points(cloud.points, method, at_least=10)
    note_coarse(points, 2**depth / scale, method, "depth", run)
    note_flat(points, method, run, "the surface continues beyond them, to the border of the box")
    return points


def outward_surface(solution: Solution, points: np.ndarray, normals: np.ndarray, method: str, run: Run) -> Trimesh:
    """The surface of a solution, with a positive volume; the points with these normals are stored as ``oriented``.

    Raises
    ------
    BadInput
        If there is no surface.
    """
    from trimesh import Trimesh

    vertices, faces = solution.vertices, solution.faces
    if not len(faces):
        raise BadInput(f"{method}: {len(points)} points have no Poisson surface; expected points of a surface")
    if enclosed_volume(vertices, faces) < 0:
        faces, normals = faces[:, ::-1], -normals
    run.keep("oriented", PointCloud(points, normals))
    return Trimesh(vertices, faces, process=False)


def enclosed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """The signed volume between the faces (f, 3) and the mean of the vertices (v, 3); positive if they face outward."""
    a, b, c = (vertices[faces[:, corner]] - vertices.mean(axis=0) for corner in range(3))
    return float(np.einsum("ni,ni->", a, np.cross(b, c)) / 6)
