"""Points outside the silhouettes are moved to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..renderer.camera import Camera

NEAR = 1.0  # distances from the silhouette up to this number of pixels are ignored


class Silhouettes:
    """The silhouettes of the shape; a point that any view shows elsewhere is outside of it.

    The gradient of Eq. 3.12 cannot bring such a point back: all pixels that it covers push it away, and to
    both sides equally. Here it moves to the nearest pixel of the silhouette, at its depth.

    Parameters
    ----------
    masks : (v, h, w) bool array
    cameras : sequence of Camera
    """

    def __init__(self, masks: np.ndarray, cameras: Sequence[Camera]):
        # An empty mask does not constrain the shape, as if this were everywhere.
        self._masks = masks | ~masks.any(axis=(1, 2), keepdims=True)
        self._cameras = cameras
        self._nearest: dict[int, np.ndarray] = {}

    def offsets(self, points: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """The displacements of points (n, 3): the mean over those of the ``chosen`` views that show them outside."""
        total, outside = np.zeros_like(points), np.zeros(len(points))
        for view in chosen:
            camera, nearest = self._cameras[view], self._nearest_of(view)
            place = camera.to_camera(points)
            ahead = place[:, 2] > 0
            fx, fy, skew, cx, cy = camera.lens()
            depth = np.where(ahead, place[:, 2], 1.0)
            x, y = place[:, 0] / depth, place[:, 1] / depth
            column, row = fx * x + skew * y + cx, fy * y + cy
            height, width = nearest.shape[1:]
            i, j = np.clip(row.astype(int), 0, height - 1), np.clip(column.astype(int), 0, width - 1)
            at = nearest[:, i, j]
            down, right = at[0] + 0.5 - row, at[1] + 0.5 - column
            off = ahead & (np.maximum(abs(down), abs(right)) > NEAR)
            # A silhouette that touches the border of an image may continue beyond it.
            border = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            off &= border | ~self._masks[view][i, j]
            move = np.stack([(right - skew * down / fy) / fx, down / fy, np.zeros(len(points))], axis=1)
            total += np.where(off[:, None], move * depth[:, None], 0.0) @ camera.rotation
            outside += off
        return total / np.maximum(outside, 1)[:, None]

    def _nearest_of(self, view: int) -> np.ndarray:
        """Row and column (2, h, w) of the nearest pixel of the silhouette, for each pixel."""
        from scipy.ndimage import distance_transform_edt

        if view not in self._nearest:
            _, index = distance_transform_edt(~self._masks[view], return_indices=True)
            self._nearest[view] = index.astype(np.int32)
        return self._nearest[view]
