"""A mesh of oriented points: screened Poisson by Open3D."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench import PointCloud

if TYPE_CHECKING:
    from trimesh import Trimesh

DEPTH = 8  # of the octree


def poisson_mesh(cloud: PointCloud, trim: float) -> Trimesh:
    """The surface of points with normals (Kazhdan and Hoppe 2013), closed unless it is trimmed.

    Parameters
    ----------
    cloud : PointCloud
        With normals.
    trim : float
        This share of the vertices, those supported by the fewest points, is removed.
    """
    import open3d as o3d
    from trimesh import Trimesh

    assert cloud.normals is not None
    oriented = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points.copy()))
    oriented.normals = o3d.utility.Vector3dVector(cloud.normals.copy())
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        mesh, support = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            oriented,
            depth=DEPTH,
            n_threads=1,  # more change order and last digits from run to run, and are not faster
        )
    if trim:
        support = np.asarray(support)
        mesh.remove_vertices_by_mask(support < np.quantile(support, trim))
    return Trimesh(np.array(mesh.vertices), np.array(mesh.triangles), process=False)
