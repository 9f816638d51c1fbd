"""The part of a mesh visible in one depth image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .cloud import PointCloud

if TYPE_CHECKING:
    from trimesh import Trimesh

AWAY = 3.0  # from the origin to the camera, where the mesh has radius 1
WIDE = 1.1  # half of the width of what is seen at the origin
PIXELS = 400  # along each side
AZIMUTH, ELEVATION = np.radians(35), np.radians(20)  # from the front, -y, to the left, and up


def depth_points(mesh: Trimesh) -> PointCloud:
    """The points of a mesh that a depth camera sees, with normals: one for each pixel that hits it.

    The camera looks at the origin from the front left, a little above.
    """
    from open3d.core import Tensor
    from open3d.t.geometry import RaycastingScene

    scene = RaycastingScene(nthreads=1)
    scene.add_triangles(Tensor(mesh.vertices.astype(np.float32)), Tensor(mesh.faces.astype(np.uint32)))
    back = np.array([np.sin(AZIMUTH) * np.cos(ELEVATION), -np.cos(AZIMUTH) * np.cos(ELEVATION), np.sin(ELEVATION)])
    right = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0])
    up = np.cross(back, right)
    across = (np.arange(PIXELS) + 0.5) / PIXELS * 2 * WIDE - WIDE
    u, v = (axis.reshape(-1, 1) for axis in np.meshgrid(across, across))
    ways = u * right + v * up - AWAY * back
    rays = np.hstack([np.broadcast_to(AWAY * back, ways.shape), ways])
    hits = scene.cast_rays(Tensor(rays.astype(np.float32)))
    depth = hits["t_hit"].numpy().astype(np.float64)
    seen = np.isfinite(depth)
    normals = hits["primitive_normals"].numpy().astype(np.float64)[seen]
    normals *= np.where(np.einsum("na,na->n", normals, ways[seen]) > 0, -1.0, 1.0)[:, None]
    return PointCloud(AWAY * back + depth[seen, None] * ways[seen], normals)


def mirrored(cloud: PointCloud) -> PointCloud:
    """A cloud and its mirror image at x = 0."""
    flip = np.array([-1.0, 1.0, 1.0])
    return PointCloud(
        np.concatenate([cloud.points, cloud.points * flip]),
        None if cloud.normals is None else np.concatenate([cloud.normals, cloud.normals * flip]),
    )
