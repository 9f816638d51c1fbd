"""A coarse cage around a body, made from its surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench import BadInput

if TYPE_CHECKING:
    from trimesh import Trimesh

DISTANCE = 0.042  # between a body and its cage, in longest edges of its box (7.5 cm of 1.8 m)
CELLS = 64  # of the grid along that edge
TRIES = 6  # distances to try, each a fifth larger, until the whole body is inside


def body_cage(mesh: Trimesh, vertices: int, distance: float = DISTANCE) -> tuple[np.ndarray, np.ndarray]:
    """A closed mesh of about ``vertices`` vertices around all vertices of ``mesh``, its faces outward.

    The offset surface of the body is extracted by marching cubes and simplified by edge collapses under the quadric
    error; if the body then protrudes, the distance is raised.

    Raises
    ------
    BadInput
        If no such cage was found: ``vertices`` is too small for the mesh.
    """
    from scipy.spatial import cKDTree
    from skimage.measure import marching_cubes
    from trimesh import Trimesh
    from trimesh.remesh import subdivide_to_size

    from bench.geometry.used import used_vertices
    from bench.geometry.winding import inside

    used = used_vertices(mesh)
    low, size = used.min(axis=0), float(np.ptp(used, axis=0).max())
    cell = size / CELLS
    farthest = 1.2**TRIES * distance * size
    margin = farthest + 2 * cell
    counts = np.ceil((np.ptp(used, axis=0) + 2 * margin) / cell).astype(int) + 1
    grid = low - margin + cell * np.indices(counts).reshape(3, -1).T
    # Points as dense as the cells suffice for the surface: the level is some cells away from it.
    dense, _ = subdivide_to_size(mesh.vertices, mesh.faces, cell, max_iter=30)
    field = np.minimum(cKDTree(dense).query(grid, distance_upper_bound=farthest)[0], farthest)
    for attempt in range(TRIES):
        level = 1.2**attempt * distance * size
        places, faces, _, _ = marching_cubes(field.reshape(counts), level, spacing=(cell,) * 3)
        outer = max(
            Trimesh(places, faces, process=False).split(only_watertight=True),
            key=lambda part: float(np.ptp(part.vertices, axis=0).prod()),
            default=None,
        )
        if outer is None:
            continue
        cage, faces = _thinned(np.asarray(outer.vertices, dtype=np.float64) + low - margin, outer.faces, vertices)
        if Trimesh(cage, faces, process=False).is_watertight and inside(cage, faces, used).all():
            return cage, faces
    raise BadInput(
        f"no cage of about {vertices} vertices encloses the template; expected a single body, or more vertices "
        "(method.cage_vertices)"
    )


def _thinned(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    from open3d.geometry import TriangleMesh
    from open3d.utility import Vector3dVector, Vector3iVector
    from trimesh import Trimesh

    mesh = TriangleMesh(Vector3dVector(vertices), Vector3iVector(np.array(faces)))
    mesh = mesh.simplify_quadric_decimation(2 * count - 4)  # faces of a closed surface without handles
    thin = Trimesh(np.array(mesh.vertices), np.array(mesh.triangles, dtype=np.int64), process=False)
    turned = thin.faces[:, ::-1] if thin.volume < 0 else thin.faces
    return np.array(thin.vertices), np.array(turned)
