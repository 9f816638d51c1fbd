"""From a cloud to the initial mesh, and from the mesh back to a cloud."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench import BadInput, PointCloud
from bench.geometry.poisson_disk import CANDIDATES, eliminate
from bench.geometry.sampling import face_normals, sample_uniform

if TYPE_CHECKING:
    from trimesh import Trimesh

POISSON_DEPTH = 6  # of the octree
LEAST_COSINE = 0.05  # between a normal and the direction from the middle: if all have more, the cloud is star-shaped


def mesh_of(cloud: PointCloud) -> tuple[np.ndarray, np.ndarray]:
    """A closed mesh (vertices, faces) with outward faces through a cloud with normals.

    For a star-shaped cloud (all normals point away from the middle) the points are the vertices, connected as the
    convex hull of their directions from the middle on the unit sphere. Otherwise it is the screened Poisson
    surface of the points, with about as many vertices.
    """
    assert cloud.normals is not None
    middle = cloud.points.mean(axis=0)
    outwards = cloud.points - middle
    length = np.linalg.norm(outwards, axis=1, keepdims=True)
    directions = np.divide(outwards, length, out=np.zeros_like(outwards), where=length > 0)
    if (np.einsum("ni,ni->n", directions, cloud.normals) > LEAST_COSINE).all():
        faces = _connected(directions)
        if faces is not None:
            return np.array(cloud.points), faces
    return _poisson(cloud)


def _connected(directions: np.ndarray) -> np.ndarray | None:
    """The faces of the convex hull of points on the unit sphere, if all are its vertices and it contains the middle."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(directions)
    except QhullError:
        return None
    if len(hull.vertices) < len(directions) or not (hull.equations[:, 3] < 0).all():
        return None
    faces = np.ascontiguousarray(hull.simplices, dtype=np.int64)
    a, b, c = (directions[faces[:, k]] for k in range(3))
    inwards = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return faces


def _poisson(cloud: PointCloud) -> tuple[np.ndarray, np.ndarray]:
    """The screened Poisson surface of a cloud, with about as many vertices as there are points."""
    from open3d.geometry import PointCloud as Cloud
    from open3d.geometry import TriangleMesh
    from open3d.utility import Vector3dVector

    assert cloud.normals is not None
    oriented = Cloud(Vector3dVector(cloud.points.copy()))
    oriented.normals = Vector3dVector(cloud.normals.copy())
    mesh, _ = TriangleMesh.create_from_point_cloud_poisson(oriented, depth=POISSON_DEPTH, n_threads=1)
    if len(mesh.vertices) > len(cloud):
        mesh = mesh.simplify_quadric_decimation(2 * len(cloud))
    mesh.remove_unreferenced_vertices()
    vertices, faces = np.array(mesh.vertices), np.array(mesh.triangles, dtype=np.int64)
    if not len(faces):
        raise BadInput(f"the initial cloud: found no surface through its {len(cloud)} points")
    return vertices, faces


def spread_over(mesh: Trimesh, count: int, rng: np.random.Generator) -> PointCloud:
    """``count`` points, evenly spread over a mesh, with face normals."""
    points, faces = sample_uniform(mesh, CANDIDATES * count, rng)
    return PointCloud(*eliminate(points, face_normals(mesh)[faces], mesh, count))
