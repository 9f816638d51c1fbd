"""The footprints of surfels in a camera: data for the exact intersection, and the tiles that they touch."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..renderer.camera import Camera
from ..renderer.raster import binned

TILE = 8  # pixels: surfels are small, and a pixel tests all of its tile
LEAST_ALPHA = 1 / 255  # surfels more transparent than this at a pixel are not drawn there
LOW_PASS = 2.0  # 1 / variance of the screen-space Gaussian: sqrt(2) / 2 pixels

# Columns of the table: the ray r = (x, y, 1) of a pixel meets the plane at the depth z = PLANE / (NORMAL . r), where
# u = z (U . r) - U_AT and v = z (V . r) - V_AT.
NORMAL, PLANE, U, U_AT, V, V_AT, CENTRE, DEPTH, OPACITY, LIMIT = 0, 3, 4, 7, 8, 11, 12, 14, 15, 16
COLUMNS = 17


class Surfels(NamedTuple):
    """Flat Gaussians, in the axes of the world or of a camera."""

    positions: np.ndarray
    """(n, 3) float64 array: centres"""
    frames: np.ndarray
    """(n, 3, 3) float64 array: the columns are the two tangents and the normal, of unit length"""
    scales: np.ndarray
    """(n, 2) float64 array: standard deviations along the tangents, in the unit of the positions"""
    opacities: np.ndarray
    """(n,) float64 array: alpha at the centre, above 0 and below 1"""

    def in_camera(self, camera: Camera) -> Surfels:
        """The same in the axes of a camera."""
        rotation = np.asarray(camera.rotation, dtype=np.float64)
        return self._replace(positions=camera.to_camera(self.positions), frames=rotation @ self.frames)


class Footprints(NamedTuple):
    """Surfels of one image, sorted into tiles."""

    shown: np.ndarray
    """(n,) bool array"""
    table: np.ndarray
    """(n, COLUMNS) float64 array"""
    starts: np.ndarray
    """(tiles + 1,) int64 array: the first member of each tile, and the end"""
    members: np.ndarray
    """int32 array: surfels of each tile, the nearest centre first"""


def footprints(seen: Surfels, camera: Camera, near: float = 1e-3) -> Footprints:
    """The footprints of surfels whose normals point towards the camera; the others are not drawn.

    Parameters
    ----------
    seen : Surfels
        In the axes of the camera.
    camera : Camera
    near : float
        Surfels whose support comes nearer to the plane of the camera are not drawn.
    """
    shown, table, box = _place(*seen, camera.lens(), near)
    order = np.argsort(seen.positions[:, 2], kind="stable")
    place, half = np.ascontiguousarray(box[:, :2]), np.ascontiguousarray(box[:, 2:])
    return Footprints(shown, table, *binned(order, shown, place, half, (camera.width, camera.height), TILE))


@njit(cache=True)
def _place(positions, frames, scales, opacities, lens, near):
    fx, fy, skew, cx, cy = lens
    n = len(positions)
    shown, table, box = np.zeros(n, np.bool_), np.zeros((n, COLUMNS)), np.zeros((n, 4))
    rows = np.zeros((3, 3))  # of the map from (u, v, 1) to the pixel, homogeneous
    for k in range(n):
        x, y, z = positions[k]
        plane = frames[k, 0, 2] * x + frames[k, 1, 2] * y + frames[k, 2, 2] * z
        limit = 2 * math.log(max(opacities[k], 1e-30) / LEAST_ALPHA)
        if z <= near or limit <= 0 or plane >= 0:
            continue
        for axis in range(2):
            a, b, c = frames[k, 0, axis], frames[k, 1, axis], frames[k, 2, axis]
            start, inverse = (U, V)[axis], 1 / scales[k, axis]
            table[k, start], table[k, start + 1], table[k, start + 2] = a * inverse, b * inverse, c * inverse
            table[k, start + 3] = (a * x + b * y + c * z) * inverse
            for row, value in enumerate((fx * a + skew * b + cx * c, fy * b + cy * c, c)):
                rows[row, axis] = value * scales[k, axis]
        rows[0, 2], rows[1, 2], rows[2, 2] = fx * x + skew * y + cx * z, fy * y + cy * z, z
        # The box of the conic u^2 + v^2 = limit: it is an ellipse if all of it lies in front of the camera.
        reach = math.sqrt(limit * (rows[2, 0] ** 2 + rows[2, 1] ** 2))
        if z - reach <= near:
            continue
        below = limit * (rows[2, 0] ** 2 + rows[2, 1] ** 2) - z * z
        blurred = math.sqrt(limit / LOW_PASS)
        for axis in range(2):
            mixed = limit * (rows[axis, 0] * rows[2, 0] + rows[axis, 1] * rows[2, 1]) - rows[axis, 2] * z
            square = limit * (rows[axis, 0] ** 2 + rows[axis, 1] ** 2) - rows[axis, 2] ** 2
            middle = mixed / below
            half = math.sqrt(max(middle * middle - square / below, 0.0))
            centre = rows[axis, 2] / z
            low, high = min(middle - half, centre - blurred), max(middle + half, centre + blurred)
            box[k, axis], box[k, 2 + axis] = 0.5 * (low + high), 0.5 * (high - low)
            table[k, CENTRE + axis] = centre
        for axis in range(3):
            table[k, NORMAL + axis] = frames[k, axis, 2]
        table[k, PLANE], table[k, DEPTH] = plane, z
        table[k, OPACITY], table[k, LIMIT] = opacities[k], limit
        shown[k] = True
    return shown, table, box
