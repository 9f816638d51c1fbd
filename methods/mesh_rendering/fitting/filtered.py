"""Meshes filtered by filtering their images."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from bench import BadInput, PointCloud, Views
from bench.geometry.spiral import golden_spiral

from ..raster.scene import Drawn, Scene
from .gallery import Gallery

RADII = (1.0, 2.0, 3.0)  # of the balls that roll over the points, in spacings
DISTANCE = 3.0  # of the cameras, in radii of the mesh
SUN, AMBIENT = 0.9, 0.1


def mesh_through(cloud: PointCloud, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """The points of a cloud with normals as the vertices (n, 3) of a mesh, and its faces, by ball pivoting."""
    from open3d.geometry import PointCloud as Cloud
    from open3d.geometry import TriangleMesh
    from open3d.utility import DoubleVector, Vector3dVector

    assert cloud.normals is not None
    oriented = Cloud(Vector3dVector(cloud.points.copy()))
    oriented.normals = Vector3dVector(cloud.normals.copy())
    radii = DoubleVector([radius * spacing for radius in RADII])
    faces = np.array(TriangleMesh.create_from_point_cloud_ball_pivoting(oriented, radii).triangles, dtype=np.int64)
    if not len(faces):
        raise BadInput(
            f"no ball of {RADII[-1]:g} spacings rests on three of the {len(cloud)} points; expected points of a surface"
        )
    return np.array(cloud.points), faces


def rig(vertices: np.ndarray, count: int, pixels: int, rng: np.random.Generator) -> Views:
    """``count`` cameras around a mesh, in random directions, each with its own three lights; the images are black."""
    middle = vertices.mean(axis=0)
    radius = np.linalg.norm(vertices - middle, axis=1).max()
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    extrinsics, lights = [], []
    for out in golden_spiral(count) @ turn.T:
        right = np.cross(out, rng.normal(size=3))
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(right, out), -out])
        extrinsics.append(np.column_stack([axes, -axes @ (middle + DISTANCE * radius * out)]))
        lights.append([out, axes[0], axes[1]])
    focal = pixels / 2 / np.tan(np.arcsin(1 / DISTANCE))
    return Views(
        np.zeros((count, pixels, pixels, 3), dtype=np.uint8),
        np.zeros((count, pixels, pixels), dtype=bool),
        np.array(extrinsics),
        np.array([[focal, 0, pixels / 2], [0, focal, pixels / 2], [0, 0, 1]]),
        np.array(lights),
        np.tile(SUN * np.eye(3), (count, 1, 1)),
        np.full((count, 3), AMBIENT),
    )


def filtered_views(
    draw: Callable[[Scene], Drawn],
    vertices: np.ndarray,
    faces: np.ndarray,
    views: Views,
    image_filter: Callable[[np.ndarray], np.ndarray],
) -> Views:
    """The images of a mesh in some views, filtered except for their background."""
    from ..raster.shading import normals_of

    gallery, normals = Gallery(views, faces, draw, 0.0), normals_of(vertices, faces)
    images, masks = np.zeros_like(views.images), np.zeros_like(views.masks)
    for view, image in enumerate(_drawn(gallery, vertices, normals)):
        masks[view] = image[..., 3] > 0
        wanted = np.where(masks[view][..., None], image_filter(image[..., :3]), 0.0)
        images[view] = np.rint(255 * np.clip(wanted, 0, 1))
    return Views.of(views.arrays() | {"images": images, "masks": masks})


def _drawn(gallery: Gallery, vertices: np.ndarray, normals) -> Iterator[np.ndarray]:
    for view in range(len(gallery.views)):
        yield gallery.draw(vertices, normals, view).image
