"""Lens distortion by a polynomial (Brown 1971), and its removal from images."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Lens(NamedTuple):
    """Coefficients as OpenCV and COLMAP name them; all 0 for a pinhole.

    A point (x, y) at depth 1 with r^2 = x^2 + y^2 is seen at
    ``x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)``, and likewise in y with p1 and p2 exchanged.
    """

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    def distort(self, points: np.ndarray) -> np.ndarray:
        """Where points (..., 2) at depth 1 are seen."""
        x, y = points[..., 0], points[..., 1]
        square = x * x + y * y
        radial = 1 + square * (self.k1 + square * (self.k2 + square * self.k3))
        return np.stack(
            [
                x * radial + 2 * self.p1 * x * y + self.p2 * (square + 2 * x * x),
                y * radial + 2 * self.p2 * x * y + self.p1 * (square + 2 * y * y),
            ],
            axis=-1,
        )

    @property
    def reach(self) -> float:
        """The radius up to which r (1 + k1 r^2 + ...) rises; beyond it the polynomial folds back and means nothing."""
        roots = np.roots([7 * self.k3, 5 * self.k2, 3 * self.k1, 1.0])  # its derivative, in r^2
        turns = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)].real
        return float(np.sqrt(turns.min())) if len(turns) else np.inf


def undistorted(image: np.ndarray, mask: np.ndarray, intrinsics: np.ndarray, lens: Lens) -> tuple[np.ndarray, ...]:
    """What a pinhole camera with the same intrinsics sees: image and mask by bilinear interpolation.

    Pixels that the lens did not see are black and outside the mask.

    Parameters
    ----------
    image : (h, w, 3) uint8 array
    mask : (h, w) bool array
    intrinsics : (3, 3) array
    lens : Lens

    Returns
    -------
    (h, w, 3) uint8 array, (h, w) bool array
    """
    from scipy.ndimage import map_coordinates

    height, width = mask.shape
    (fx, skew, cx), (_, fy, cy), _ = intrinsics
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    y = (rows - cy) / fy
    points = np.stack([(columns - cx - skew * y) / fx, y], axis=-1)
    seen = lens.distort(points)
    columns, rows = fx * seen[..., 0] + skew * seen[..., 1] + cx, fy * seen[..., 1] + cy
    inside = (columns >= 0) & (columns <= width) & (rows >= 0) & (rows <= height)
    inside &= np.linalg.norm(points, axis=-1) < lens.reach

    def sampled(channel: np.ndarray) -> np.ndarray:
        values = map_coordinates(channel.astype(np.float32), [rows - 0.5, columns - 0.5], order=1, mode="nearest")
        return np.where(inside, values, 0)

    colors = np.stack([sampled(image[..., channel]) for channel in range(3)], axis=-1)
    return np.rint(colors).astype(np.uint8), sampled(mask) > 0.5
