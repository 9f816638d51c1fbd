"""Ray casting against a mesh, and the view of a pinhole camera.

Rays are cast in float32 (Embree, in open3d), on one thread; a hit is then computed in float64 from its triangle and
its barycentric coordinates, so that it lies on the mesh to rounding, and off its ray by about 1e-7 of the distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench.geometry.sampling import face_normals
from bench.geometry.used import used_vertices

from .views import Pose

if TYPE_CHECKING:
    from trimesh import Trimesh

OFFSET = 1e-4  # of the radius: how far above the surface a shadow ray starts, so that it does not hit its own face


class Scene:
    """A mesh for ray casting.

    Attributes
    ----------
    center, radius : (3,) array, float
        The centre of the bounding box, and the distance of the farthest vertex from it.
    normals : (f, 3) array
        Unit normals of the faces, by their winding.
    """

    def __init__(self, mesh: Trimesh):
        from open3d.core import Tensor
        from open3d.t.geometry import RaycastingScene

        self._vertices = np.asarray(mesh.vertices, dtype=np.float64)
        self._faces = np.asarray(mesh.faces)
        used = used_vertices(mesh)
        self.center = (used.min(axis=0) + used.max(axis=0)) / 2
        self.radius = float(np.linalg.norm(used - self.center, axis=1).max())
        self.normals = face_normals(mesh)
        self._flat = ~np.asarray(self.normals.any(axis=1))
        self._scene = RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            Tensor(self._vertices.astype(np.float32)), Tensor(np.ascontiguousarray(self._faces, dtype=np.uint32))
        )

    def cast(self, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The first hits of rays from one origin (3,) along ``directions`` (n, 3).

        Returns
        -------
        rays : (m,) int array
            Which rays hit; no ray hits a face without an area.
        points : (m, 3) float64 array
        faces : (m,) int array
        """
        rays = np.empty((len(directions), 6), dtype=np.float32)
        rays[:, :3], rays[:, 3:] = origin, directions
        answer = self._scene.cast_rays(_tensor(rays), nthreads=1)
        hit = np.flatnonzero(np.isfinite(answer["t_hit"].numpy()))
        faces = answer["primitive_ids"].numpy()[hit].astype(np.int64)
        if self._flat.any():
            solid = ~self._flat[faces]
            hit, faces = hit[solid], faces[solid]
        u, v = answer["primitive_uvs"].numpy()[hit].astype(np.float64).T[:, :, None]
        corners = self._faces[faces]
        points = (1 - u - v) * self._vertices[corners[:, 0]]
        points += u * self._vertices[corners[:, 1]]
        points += v * self._vertices[corners[:, 2]]
        return hit, points, faces

    def sees(self, points: np.ndarray, faces: np.ndarray, viewers: np.ndarray) -> np.ndarray:
        """Whether nothing lies between points of the mesh and their viewers.

        Parameters
        ----------
        points : (n, 3) array
        faces : (n,) int array
            A face that each point lies on; the ray starts just above it, on the viewer's side.
        viewers : (3,) or (n, 3) array

        Returns
        -------
        (n,) bool array
        """
        towards = viewers - points
        normals = self.normals[faces]
        side = np.where(np.einsum("ni,ni->n", normals, towards) < 0, -1.0, 1.0)[:, None]
        start = points + OFFSET * self.radius * side * normals
        rays = np.concatenate([start, viewers - start], axis=1).astype(np.float32)
        return ~self._scene.test_occlusions(_tensor(rays), tfar=1.0, nthreads=1).numpy()


def _tensor(rays: np.ndarray):
    from open3d.core import Tensor

    return Tensor.from_numpy(rays)


@dataclass(frozen=True, eq=False)
class View:
    """The view of a pinhole camera: one entry for each pixel whose ray hits.

    Attributes
    ----------
    pose : Pose
    focal : float
        In pixels.
    width : int
        Of the square image, in pixels.
    index : (n,) int array
        Place of the pixel in the image, row by row.
    pixels : (n, 2) array
        Column and row from the middle of the image, in pixels.
    points, faces : (n, 3) and (n,) arrays
        The hits.
    depth : (n,) array
        Along the optical axis.
    cosine : (n,) array
        Of the angle between ray and face normal, 0..1.
    """

    pose: Pose
    focal: float
    width: int
    index: np.ndarray
    pixels: np.ndarray
    points: np.ndarray
    faces: np.ndarray
    depth: np.ndarray
    cosine: np.ndarray

    def unproject(self, depth: np.ndarray, pixels: np.ndarray | None = None) -> np.ndarray:
        """The points (m, 3) at depths (m,) behind the view's pixels, or behind others ``pixels`` (m, 2)."""
        pixels = self.pixels if pixels is None else pixels
        across = pixels / self.focal
        rays = across[:, :1] * self.pose.axes[0] + across[:, 1:] * self.pose.axes[1] + self.pose.axes[2]
        return self.pose.center + depth[:, None] * rays


def focal_length(scene: Scene, distance: float, width: int) -> float:
    """The focal length in pixels at which the bounding sphere, ``distance`` radii away, just fills the image."""
    return width / 2 * np.sqrt(distance**2 - 1)


def see(scene: Scene, pose: Pose, focal: float, width: int) -> View:
    """Cast a ray through the middle of every pixel of a square image."""
    line = np.arange(width) - (width - 1) / 2
    x, y = np.meshgrid(line, line)
    # Outside this circle (a pixel wider than necessary) no ray meets the bounding sphere.
    distance = np.linalg.norm(pose.center - scene.center)
    reach = focal * scene.radius / np.sqrt(distance**2 - scene.radius**2) + 1
    tried = np.flatnonzero((x**2 + y**2).ravel() <= reach**2)
    pixels = np.stack([x.ravel()[tried], y.ravel()[tried]], axis=1)
    directions = np.column_stack([pixels / focal, np.ones(len(pixels))]) @ pose.axes
    hit, points, faces = scene.cast(pose.center, directions)
    rays = points - pose.center
    cosine = np.abs(np.einsum("ni,ni->n", rays, scene.normals[faces])) / np.linalg.norm(rays, axis=1)
    return View(pose, focal, width, tried[hit], pixels[hit], points, faces, rays @ pose.axes[2], np.minimum(cosine, 1))
