"""A pinhole camera, in the conventions of :class:`bench.Views`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bench import Views


@dataclass(frozen=True, eq=False)
class Camera:
    """One camera: x to the right, y down, z forward; the centre of pixel (row i, column j) is at (j + 0.5, i + 0.5).

    Parameters
    ----------
    extrinsics : (3, 4) array
        World to camera.
    intrinsics : (3, 3) array
        ``[[fx, s, cx], [0, fy, cy], [0, 0, 1]]``, in pixels.
    width, height : int
        Of the image, in pixels.
    """

    extrinsics: np.ndarray
    intrinsics: np.ndarray
    width: int
    height: int

    @classmethod
    def of(cls, views: Views, number: int) -> Camera:
        """The camera of one view."""
        return cls(views.extrinsics[number], views.intrinsics[number], views.width, views.height)

    @classmethod
    def looking_at(
        cls, eye: np.ndarray, target: np.ndarray, up: np.ndarray, focal: float, width: int, height: int
    ) -> Camera:
        """A camera at ``eye`` with ``target`` in the middle of its image, and a focal length in pixels.

        ``up`` points upwards in the image; if it is parallel to the view, any direction is upwards.
        """
        forward = np.asarray(target, dtype=np.float64) - eye
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, up)
        if np.linalg.norm(right) < 1e-9 * np.linalg.norm(up):
            right = np.cross(forward, np.eye(3)[np.abs(forward).argmin()])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        extrinsics = np.column_stack([rotation, -rotation @ eye])
        intrinsics = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
        return cls(extrinsics, intrinsics, width, height)

    @property
    def rotation(self) -> np.ndarray:
        """World to camera: (3, 3)."""
        return np.asarray(self.extrinsics)[:, :3]

    @property
    def center(self) -> np.ndarray:
        """Its position in the world: (3,)."""
        return -self.rotation.T @ np.asarray(self.extrinsics)[:, 3]

    def lens(self) -> tuple[float, float, float, float, float]:
        """fx, fy, skew, cx and cy, in pixels."""
        k = np.asarray(self.intrinsics, dtype=np.float64)
        return float(k[0, 0]), float(k[1, 1]), float(k[0, 1]), float(k[0, 2]), float(k[1, 2])

    def to_camera(self, points: np.ndarray) -> np.ndarray:
        """Points of the world (n, 3) in the axes of the camera."""
        extrinsics = np.asarray(self.extrinsics, dtype=np.float64)
        return points @ extrinsics[:, :3].T + extrinsics[:, 3]
