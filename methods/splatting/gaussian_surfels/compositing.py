"""Front-to-back compositing of surfels, and its gradient, pixel by pixel within tiles."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ...learned.compiled.pool import in_parts
from ...learned.compiled.threads import in_use
from .footprints import CENTRE, DEPTH, LIMIT, LOW_PASS, NORMAL, OPACITY, PLANE, TILE, U_AT, V_AT, U, V

FEATURES = 6  # colour and normal of a surfel
MAPS = FEATURES + 3  # the same of a pixel, and the sums of the weights, of weighted depths and of their squares
FULL = 1e-4  # a pixel that lets less light through than this is full
# Columns of a member's gradient: by U, V, NORMAL, PLANE (and U_AT, V_AT), centre, depth, opacity and features; then the
# sum of its weights.
BY_U, BY_U_AT, BY_V, BY_V_AT = 0, 3, 4, 7
BY_NORMAL, BY_PLANE, BY_CENTRE, BY_DEPTH, BY_OPACITY, BY_FEATURES = 8, 11, 12, 14, 15, 16
WEIGHT = BY_FEATURES + FEATURES
GRADIENTS = WEIGHT + 1


@njit(cache=True, inline="always")
def _meet(row, x, y, column, line):
    """The intersection of the ray (x, y, 1) of the pixel at (column, line) with a surfel.

    Returns the squared distance in standard deviations, the depth, u, v, and whether the low-pass applies.
    """
    slope = row[NORMAL] * x + row[NORMAL + 1] * y + row[NORMAL + 2]
    depth = 0.0
    if slope != 0:
        depth = row[PLANE] / slope
    dx, dy = column - row[CENTRE], line - row[CENTRE + 1]
    blurred = LOW_PASS * (dx * dx + dy * dy)
    if not depth > 0:  # the ray is parallel to the plane or meets it behind the camera
        return blurred, row[DEPTH], 0.0, 0.0, True
    u = depth * (row[U] * x + row[U + 1] * y + row[U + 2]) - row[U_AT]
    v = depth * (row[V] * x + row[V + 1] * y + row[V + 2]) - row[V_AT]
    exact = u * u + v * v
    if exact <= blurred:
        return exact, depth, u, v, False
    return blurred, row[DEPTH], 0.0, 0.0, True


def composite(
    table: np.ndarray, features: np.ndarray, starts: np.ndarray, members: np.ndarray, lens: tuple, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The maps (h, w, MAPS), the transmittance (h, w), and the end (h, w) of the members drawn at each pixel."""
    width, height = size
    maps, light = np.zeros((height, width, MAPS)), np.ones((height, width))
    last = np.zeros((height, width), np.int64)
    in_parts(_composite, len(starts) - 1, in_use(), table, features, starts, members, lens, maps, light, last)
    return maps, light, last


@njit(nogil=True, cache=True)
def _composite(begin, end, table, features, starts, members, lens, maps, light, last):
    for tile in range(begin, end):
        _tile(tile, table, features, starts, members, lens, maps, light, last)


@njit(cache=True)
def _tile(tile, table, features, starts, members, lens, maps, light, last):
    height, width = light.shape
    fx, fy, skew, cx, cy = lens
    across = (width + TILE - 1) // TILE
    top, left = tile // across * TILE, tile % across * TILE
    for i in range(top, min(top + TILE, height)):
        y = (i + 0.5 - cy) / fy
        for j in range(left, min(left + TILE, width)):
            x = (j + 0.5 - cx - skew * y) / fx
            passing = 1.0
            last[i, j] = starts[tile]
            for member in range(starts[tile], starts[tile + 1]):
                k = members[member]
                square, depth, _, _, _ = _meet(table[k], x, y, j + 0.5, i + 0.5)
                if square > table[k, LIMIT]:
                    continue
                alpha = table[k, OPACITY] * math.exp(-0.5 * square)
                weight = passing * alpha
                for c in range(FEATURES):
                    maps[i, j, c] += weight * features[k, c]
                maps[i, j, FEATURES] += weight
                maps[i, j, FEATURES + 1] += weight * depth
                maps[i, j, FEATURES + 2] += weight * depth * depth
                passing *= 1 - alpha
                last[i, j] = member + 1
                if passing < FULL:
                    break
            light[i, j] = passing


def composite_back(
    table: np.ndarray,
    features: np.ndarray,
    starts: np.ndarray,
    members: np.ndarray,
    lens: tuple,
    light: np.ndarray,
    last: np.ndarray,
    slopes: np.ndarray,
) -> np.ndarray:
    """The gradients (members, GRADIENTS) of a loss, from its slopes (h, w, MAPS) by the maps."""
    back = np.zeros((len(members), GRADIENTS))
    arguments = (table, features, starts, members, lens, light, last, slopes, back)
    in_parts(_composite_back, len(starts) - 1, in_use(), *arguments)
    return back


@njit(nogil=True, cache=True)
def _composite_back(begin, end, table, features, starts, members, lens, light, last, slopes, back):
    for tile in range(begin, end):
        _tile_back(tile, table, features, starts, members, lens, light, last, slopes, back)


@njit(cache=True)
def _tile_back(tile, table, features, starts, members, lens, light, last, slopes, back):
    height, width = light.shape
    fx, fy, skew, cx, cy = lens
    across = (width + TILE - 1) // TILE
    top, left = tile // across * TILE, tile % across * TILE
    for i in range(top, min(top + TILE, height)):
        y = (i + 0.5 - cy) / fy
        for j in range(left, min(left + TILE, width)):
            x = (j + 0.5 - cx - skew * y) / fx
            passing, behind = light[i, j], 0.0  # behind: the weighted slopes of the surfels behind
            slope = slopes[i, j]
            for member in range(last[i, j] - 1, starts[tile] - 1, -1):
                row = table[members[member]]
                square, depth, u, v, blurred = _meet(row, x, y, j + 0.5, i + 0.5)
                if square > row[LIMIT]:
                    continue
                shape = math.exp(-0.5 * square)
                alpha = row[OPACITY] * shape
                passing /= 1 - alpha
                weight = passing * alpha
                gain = slope[FEATURES] + depth * (slope[FEATURES + 1] + depth * slope[FEATURES + 2])
                for c in range(FEATURES):
                    gain += slope[c] * features[members[member], c]
                    back[member, BY_FEATURES + c] += weight * slope[c]
                back[member, WEIGHT] += weight
                by_alpha = passing * gain - behind / (1 - alpha)
                behind += weight * gain
                by_depth = weight * (slope[FEATURES + 1] + 2 * depth * slope[FEATURES + 2])
                back[member, BY_OPACITY] += by_alpha * shape
                _through(
                    back[member], row, (x, y, j + 0.5, i + 0.5), (depth, u, v, blurred), -by_alpha * alpha, by_depth
                )


@njit(cache=True, inline="always")
def _through(back, row, pixel, met, by_half_square, by_depth):
    """Add the gradient of one pixel: from those by the exponent and by the depth to those by the row."""
    x, y, column, line = pixel
    depth, u, v, blurred = met
    if blurred:
        back[BY_CENTRE] -= by_half_square * LOW_PASS * (column - row[CENTRE])
        back[BY_CENTRE + 1] -= by_half_square * LOW_PASS * (line - row[CENTRE + 1])
        back[BY_DEPTH] += by_depth
        return
    by_u, by_v = by_half_square * u, by_half_square * v
    back[BY_U] += by_u * depth * x
    back[BY_U + 1] += by_u * depth * y
    back[BY_U + 2] += by_u * depth
    back[BY_U_AT] -= by_u
    back[BY_V] += by_v * depth * x
    back[BY_V + 1] += by_v * depth * y
    back[BY_V + 2] += by_v * depth
    back[BY_V_AT] -= by_v
    slope = row[NORMAL] * x + row[NORMAL + 1] * y + row[NORMAL + 2]
    by_depth += by_u * (row[U] * x + row[U + 1] * y + row[U + 2]) + by_v * (row[V] * x + row[V + 1] * y + row[V + 2])
    back[BY_PLANE] += by_depth / slope
    by_slope = -by_depth * depth / slope
    back[BY_NORMAL] += by_slope * x
    back[BY_NORMAL + 1] += by_slope * y
    back[BY_NORMAL + 2] += by_slope


@njit(cache=True)
def gathered(back, members, count):
    """The sums (count, GRADIENTS) over the tiles that a surfel touches, always in the same order."""
    total = np.zeros((count, GRADIENTS))
    for member in range(len(members)):
        for c in range(GRADIENTS):
            total[members[member], c] += back[member, c]
    return total
