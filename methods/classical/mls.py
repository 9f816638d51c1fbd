"""Moving least squares surfaces, by MeshLab: the common part of APSS and RIMLS.

MeshLab's filters are called by name; ``kind`` is ``"apss"`` or ``"rimls"``, and further keyword arguments are those
of the filter. Both need oriented normals. The support of a point is ``filterscale`` times its local spacing.

MeshLab 2025.7 stops its projection at an accuracy relative to a mean spacing that it never sets (``MlsSurface::
mAveragePointSpacing``), so the result depends on uninitialised memory: by 6e-4 where it was observed. Here the
projection is called for one step at a time, which does not use that accuracy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bench import BadInput, PointCloud, Run

from .inputs import distinct_oriented, note_coarse, plane_axes
from .isolated import put_back, without_isolated
from .noise import noise_to_spacing

if TYPE_CHECKING:
    import pymeshlab
    from trimesh import Trimesh

AT_LEAST = 20  # MeshLab measures the local spacing from 16 neighbours
AROUND = 16  # neighbours for the local spacing here, too
# The support as a polynomial of the noise: less than 2 leaves holes in a surface, but suffices for projection.
AT_POINTS, OF_SURFACE = (1.6, 6.0, 0.0), (2.0, 3.5, 5.0)
MOST = 6.0
FEW = 4  # cells of the grid through the thickness of the points, at least
CONTROL, PROXY = 0, 1  # indices in the mesh set: the points that define the surface, and what moves


def check_parameters(filterscale: float | None, resolution: int, steps: int, reach: float) -> None:
    """Raise ValueError for parameters on which MeshLab would crash or hang."""
    if filterscale is not None and not filterscale > 0:
        raise ValueError(f"filterscale: expected a number above 0, got {filterscale}")
    if resolution < 2:
        raise ValueError(f"resolution: expected at least 2, got {resolution}")
    if steps < 1:
        raise ValueError(f"steps: expected at least 1, got {steps}")
    if not reach >= 0:
        raise ValueError(f"reach: expected a number of at least 0, got {reach}")


def project(cloud: PointCloud, kind: str, run: Run, steps: int, **parameters: Any) -> PointCloud:
    """Every point projected to the surface; isolated ones, and those beyond the support of others, do not move.

    Raises
    ------
    BadInput
        See :func:`distinct_points`.
    """
    rest, kept = without_isolated(cloud, kind, run)
    points, normals, inverse = distinct_oriented(rest, kind, AT_LEAST)
    parameters = _supported(parameters, points, normals, AT_POINTS)
    return put_back(cloud, kept, _moved(points, normals, points, kind, steps, parameters)[inverse])


def upsample(cloud: PointCloud, ratio: int, kind: str, run: Run, steps: int, **parameters: Any) -> PointCloud:
    """Exactly ``ratio`` times as many points of the surface, evenly; the projected ones of the input come first.

    Raises
    ------
    BadInput
        See :func:`distinct_points`.
    """
    from .refinement import refine

    count = ratio * len(cloud)
    cloud, _ = without_isolated(cloud, kind, run)
    points, normals, _ = distinct_oriented(cloud, kind, AT_LEAST)
    parameters = _supported(parameters, points, normals, OF_SURFACE)

    def onto_surface(queries: np.ndarray) -> np.ndarray:
        return _moved(points, normals, queries, kind, steps, parameters)

    return PointCloud(refine(onto_surface(points), count, onto_surface))


def isosurface(
    cloud: PointCloud, kind: str, run: Run, resolution: int, steps: int, reach: float, **parameters: Any
) -> Trimesh:
    """The surface by marching cubes; open where points are missing.

    Between parts that are closer to each other than the support, the field has zeros away from all points: sheets
    that join the parts. Surface farther from all points than ``reach`` local spacings is dropped, unless that is 0.

    Raises
    ------
    BadInput
        See :func:`distinct_points`; or if the field has no surface.
    """
    import pymeshlab
    from trimesh import Trimesh

    cloud, _ = without_isolated(cloud, kind, run)
    points, normals, _ = distinct_oriented(cloud, kind, AT_LEAST)
    parameters = _supported(parameters, points, normals, OF_SURFACE)
    note_coarse(points, resolution, kind, "resolution", run)
    axes = _upright(points, resolution)
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points @ axes.T, v_normals_matrix=normals @ axes.T))
    meshes.apply_filter(f"generate_marching_cubes_{kind}", resolution=resolution, maxprojectioniters=1, **parameters)
    if meshes.mesh(PROXY).face_number():
        _project(meshes, kind, steps - 1, parameters)
    mesh = meshes.mesh(PROXY)
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix()
    kept = np.isfinite(vertices).all(axis=1)
    if reach > 0:
        kept[kept] = within_reach(vertices[kept] @ axes, points, reach)
    faces = faces[kept[faces].all(axis=1)]
    if not len(faces):
        raise BadInput(
            f"{kind}: found no surface in a grid of resolution {resolution} over {len(points)} points; expected points "
            "of a surface that fill their bounding box (raise resolution, or process distant parts one by one)"
        )
    used, faces = np.unique(faces, return_inverse=True)
    return Trimesh(vertices[used] @ axes, faces.reshape(-1, 3), process=False)


def within_reach(queries: np.ndarray, points: np.ndarray, reach: float) -> np.ndarray:
    """Which of the queries (m, 3) are at most ``reach`` local spacings from the nearest of the points (n, 3): (m,).

    The local spacing is the side of the square that each point has for itself, by the disk of its neighbours: on a
    surface with random points, four in a million disks of two such radii are empty.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    spacing = tree.query(points, [AROUND + 1])[0].ravel() * np.sqrt(np.pi / AROUND)
    distance, nearest = tree.query(queries)
    return distance <= reach * spacing[nearest]


def _upright(points: np.ndarray, resolution: int) -> np.ndarray:
    """A rotation for the grid: none, or, if the bounding box is flatter than a few cells, its plane to the diagonal.

    MeshLab's grid covers the bounding box, and a box without thickness has no cells.
    """
    extent = np.ptp(points, axis=0)
    if extent.min() > FEW * extent.max() / resolution:
        return np.eye(3)
    diagonal = np.array([[1.0, -1, 0], [1, 1, -2], [1, 1, 1]]) / np.sqrt([[2.0], [6.0], [3.0]])
    return diagonal.T @ plane_axes(points)[0]


def _supported(
    parameters: dict[str, Any], points: np.ndarray, normals: np.ndarray, curve: tuple[float, ...]
) -> dict[str, Any]:
    """The parameters; a support of None becomes the best one on the train shapes at this noise, see docs/tuning.md."""
    if parameters["filterscale"] is not None:
        return parameters
    return parameters | {"filterscale": min(float(np.polyval(curve[::-1], noise_to_spacing(points, normals))), MOST)}


def _project(meshes: pymeshlab.MeshSet, kind: str, steps: int, parameters: dict[str, Any]) -> None:
    """Move the vertices of the proxy mesh towards the surface of the control mesh."""
    # The filter prepares only the current mesh, and crashes if that is not the control mesh.
    meshes.set_current_mesh(CONTROL)
    for _ in range(steps):
        meshes.apply_filter(
            f"compute_mls_projection_{kind}", controlmesh=CONTROL, proxymesh=PROXY, maxprojectioniters=1, **parameters
        )


def _moved(
    points: np.ndarray, normals: np.ndarray, queries: np.ndarray, kind: str, steps: int, parameters: dict[str, Any]
) -> np.ndarray:
    """Queries (m, 3) projected to the surface of the points (n, 3); those beyond their support stay."""
    import pymeshlab
    from scipy.spatial import cKDTree

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points, v_normals_matrix=normals))
    # RIMLS starts from the normal of the query.
    nearest = normals if queries is points else normals[cKDTree(points).query(queries)[1]]
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=queries, v_normals_matrix=nearest))
    _project(meshes, kind, steps, parameters)
    moved = meshes.mesh(PROXY).vertex_matrix()
    return np.where(np.isfinite(moved).all(axis=1)[:, None], moved, queries)
