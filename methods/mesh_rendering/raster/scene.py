"""Input and output of a renderer, and the projection from the world to the screen and back."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

NEAR = 1e-6  # faces with a corner that is nearer to the camera's plane are not drawn


class Scene(NamedTuple):
    """A mesh as one camera sees it."""

    screen: np.ndarray
    """(v, 3) float64 array: column, row and depth of vertices; pixel (i, j) has its centre at (j + 0.5, i + 0.5)"""
    faces: np.ndarray
    """(f, 3) int array"""
    colors: np.ndarray
    """(f, 3) float64 array: what each face emits towards the camera"""
    width: int
    height: int
    far: float
    """Depth of the background, behind everything"""


class Drawn(Protocol):
    """An image, and its gradient."""

    @property
    def image(self) -> np.ndarray:
        """(h, w, 4) float64 array: red, green, blue, and the coverage of the pixel by the mesh (0 to 1)."""

    def backward(self, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The gradient of a loss.

        Parameters
        ----------
        slope : (h, w, 4) array
            The derivative of the loss by the image.

        Returns
        -------
        of_screen : (v, 3) float64 array
            By column, row and depth of the vertices, with constant colours.
        of_colors : (f, 3) float64 array
        """


def project(vertices: np.ndarray, extrinsics: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """Column, row and depth (v, 3) of points of the world (v, 3), for a camera in the conventions of `bench.Views`."""
    x, y, z = (vertices @ extrinsics[:, :3].T + extrinsics[:, 3]).T
    (fx, skew, cx), (_, fy, cy), _ = intrinsics
    z = np.where(z == 0, 1e-12, z)  # not drawn in any case
    return np.stack([(fx * x + skew * y) / z + cx, fy * y / z + cy, z], axis=1)


def project_back(
    of_screen: np.ndarray, screen: np.ndarray, extrinsics: np.ndarray, intrinsics: np.ndarray
) -> np.ndarray:
    """The gradient (v, 3) by points of the world, from the gradient (v, 3) by their columns, rows and depths."""
    (fx, skew, cx), (_, fy, cy), _ = intrinsics
    by_column, by_row, by_depth = of_screen.T
    column, row, z = screen.T
    by_z = by_depth - (by_column * (column - cx) + by_row * (row - cy)) / z
    by_camera = np.stack([by_column * fx / z, (by_column * skew + by_row * fy) / z, by_z], axis=1)
    return by_camera @ extrinsics[:, :3]
