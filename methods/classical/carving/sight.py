"""Which views see the voxels of a surface: one depth buffer for each view."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def depth_buffers(points, matrices, focal, cell, height, width):
    """The depth of the nearest voxel at every pixel: (v, h, w) float32 array, infinite if there is none.

    A voxel is drawn as a square as wide as the cell, half a pixel more on each side, so that no gap is left between
    neighbours.

    Parameters
    ----------
    points : (n, 3) float64 array
        The middles of the voxels.
    matrices : (v, 3, 4) float64 array
        From the world to pixels, times the depth.
    focal : (v,) float64 array
    cell : float
        The side of a voxel.
    height, width : int
    """
    buffers = np.full((len(matrices), height, width), np.inf, dtype=np.float32)
    for v in range(len(matrices)):
        buffer = buffers[v]
        for k in range(len(points)):
            column, row, depth = projected(matrices[v], points[k])
            if depth <= 1e-9:
                continue
            left, right, top, bottom = window(column, row, 0.5 * cell * focal[v] / depth + 0.5, width, height)
            for i in range(top, bottom):
                for j in range(left, right):
                    buffer[i, j] = min(buffer[i, j], depth)
    return buffers


@njit(cache=True, nogil=True)
def pixels_seen(points, matrices, buffers, masks, slack):
    """The pixel in which each view sees each voxel: (n, v) int32 array, row times width plus column, or -1.

    A view sees a voxel that projects into its mask and lies behind the nearest voxel there by at most ``slack``.
    """
    count, height, width = buffers.shape
    found = np.full((len(points), count), -1, dtype=np.int32)
    for k in range(len(points)):
        for v in range(count):
            column, row, depth = projected(matrices[v], points[k])
            if depth > 1e-9 and 0 <= column < width and 0 <= row < height:
                i, j = int(row), int(column)
                if masks[v, i, j] and depth <= buffers[v, i, j] + slack:
                    found[k, v] = i * width + j
    return found


@njit(cache=True, nogil=True)
def count_covers(points, matrices, focal, cell, height, width):
    """The number of voxels that project to every pixel: (v, h, w) int32 array; arguments as :func:`depth_buffers`."""
    covers = np.zeros((len(matrices), height, width), dtype=np.int32)
    for v in range(len(matrices)):
        for k in range(len(points)):
            column, row, depth = projected(matrices[v], points[k])
            if depth > 1e-9:
                left, right, top, bottom = window(column, row, 0.5 * cell * focal[v] / depth, width, height)
                covers[v, top:bottom, left:right] += 1
    return covers


@njit(cache=True, nogil=True)
def take(points, matrices, focal, cell, covers, masks):
    """Which of some voxels to remove, one after the other: those that are not the last one at a pixel of a mask.

    ``covers`` of :func:`count_covers` is updated to the remaining voxels.
    """
    count, height, width = covers.shape
    gone = np.zeros(len(points), dtype=np.bool_)
    windows = np.zeros((count, 4), dtype=np.int64)
    for k in range(len(points)):
        free = True
        for v in range(count):
            column, row, depth = projected(matrices[v], points[k])
            windows[v] = 0
            if depth <= 1e-9:
                continue
            left, right, top, bottom = window(column, row, 0.5 * cell * focal[v] / depth, width, height)
            windows[v, 0], windows[v, 1], windows[v, 2], windows[v, 3] = left, right, top, bottom
            for i in range(top, bottom):
                for j in range(left, right):
                    free &= covers[v, i, j] > 1 or not masks[v, i, j]
        gone[k] = free
        if free:
            for v in range(count):
                left, right, top, bottom = windows[v]
                for i in range(top, bottom):
                    for j in range(left, right):
                        covers[v, i, j] -= 1
    return gone


@njit(cache=True, nogil=True, inline="always")
def window(column, row, half, width, height):
    """The columns and rows of the pixels whose middles lie in a square: first, end, first, end."""
    left, right = max(math.ceil(column - half - 0.5), 0), min(math.floor(column + half - 0.5) + 1, width)
    top, bottom = max(math.ceil(row - half - 0.5), 0), min(math.floor(row + half - 0.5) + 1, height)
    return int(left), int(right), int(top), int(bottom)


@njit(cache=True, nogil=True, inline="always")
def projected(matrix, point):
    """Column, row and depth of a point; the first two only count where the depth is positive."""
    x, y, z = point[0], point[1], point[2]
    depth = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
    by = depth if depth > 1e-9 else 1.0
    column = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]) / by
    row = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]) / by
    return column, row, depth
