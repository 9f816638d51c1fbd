"""The splats of each pixel: lists of the nearest ones, made tile by tile."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ...learned.compiled.pool import in_parts
from ...learned.compiled.threads import in_use
from .camera import Camera
from .ellipses import Ellipses
from .settings import Drawing

TILE = 16  # pixels


class Lists(NamedTuple):
    """For each pixel the nearest splats that cover it, the nearest first."""

    index: np.ndarray  # type: ignore[assignment]  # tuples have a method of this name, not needed here
    """(h, w, K) int32 array: numbers of points, -1 for none"""
    depth: np.ndarray
    """(h, w, K) float64 array: depths at which the ray meets the tangent planes"""
    rho: np.ndarray
    """(h, w, K) float64 array: weights of Eq. 3.6"""
    front: np.ndarray
    """(h, w) int64 array: the number of visible ones; the others are hidden"""


def rasterise(ellipses: Ellipses, camera: Camera, how: Drawing) -> Lists:
    """The lists of all pixels."""
    width, height = camera.width, camera.height
    order = np.arange(len(ellipses.shown))
    starts, members = binned(order, ellipses.shown, ellipses.place, ellipses.half, (width, height), TILE)
    settings, size = (how.cutoff, how.depth_limit, how.layers), (height, width, how.layers)
    lists = Lists(np.full(size, -1, np.int32), np.full(size, np.inf), np.zeros(size), np.zeros(size[:2], np.int64))
    arguments = (tuple(ellipses), starts, members, camera.lens(), (width, height), settings, tuple(lists))
    in_parts(_rasterise, len(starts) - 1, in_use(), *arguments)
    return lists


@njit(cache=True)
def span(centre, half, count):
    """The first and last of ``count`` pixels whose middles lie within ``half`` of ``centre``; last < first for none."""
    first = max(math.ceil(centre - half - 0.5), 0)
    last = min(math.floor(centre + half - 0.5), count - 1)
    return int(first), int(last)


@njit(cache=True)
def binned(order, shown, place, half, size, tile_size):
    """The splats that touch each tile, in the order given: starts (tiles + 1,) and members.

    ``half`` (n, 2) are half the sides of the rectangles about ``place`` (n, 2) that the splats cover, in pixels.
    """
    width, height = size
    across = (width + tile_size - 1) // tile_size
    starts = np.zeros(across * ((height + tile_size - 1) // tile_size) + 1, np.int64)
    for fill in range(2):
        if fill:
            starts = starts.cumsum()
            members = np.empty(starts[-1], np.int32)
            free = starts.copy()
        for k in order:
            if not shown[k]:
                continue
            left, right = span(place[k, 0], half[k, 0], width)
            top, bottom = span(place[k, 1], half[k, 1], height)
            if right < left or bottom < top:
                continue
            for i in range(top // tile_size, bottom // tile_size + 1):
                for j in range(left // tile_size, right // tile_size + 1):
                    tile = i * across + j
                    if fill:
                        members[free[tile]] = k
                        free[tile] += 1
                    else:
                        starts[tile + 1] += 1
    return starts, members


@njit(cache=True)
def depth_at(position, normal, reach, column, row, lens):
    """The depth at which the ray of a pixel meets the tangent plane of a splat, at most ``reach`` from its centre."""
    fx, fy, skew, cx, cy = lens
    ry = (row - cy) / fy
    rx = (column - cx - skew * ry) / fx
    plane = normal[0] * position[0] + normal[1] * position[1] + normal[2] * position[2]
    slope = normal[0] * rx + normal[1] * ry + normal[2]
    if not plane * slope > 0:  # the ray passes beyond the horizon of the plane
        return position[2] + reach
    return min(max(plane / slope, position[2] - reach), position[2] + reach)


@njit(nogil=True, cache=True)
def _rasterise(begin, end, ellipses, starts, members, lens, size, settings, lists):
    """Fill the lists."""
    for tile in range(begin, end):
        _of_tile(tile, ellipses, starts, members, lens, size, settings, lists)


@njit(cache=True)
def _of_tile(tile, ellipses, starts, members, lens, size, settings, lists):
    _, place, position, normal, form, half, peak, reach = ellipses
    index, depth, rho, front = lists
    width, height = size
    cutoff, limit, layers = settings
    across = (width + TILE - 1) // TILE
    upper, lower = tile // across * TILE, min(tile // across * TILE + TILE, height)
    begin, end = tile % across * TILE, min(tile % across * TILE + TILE, width)
    for member in range(starts[tile], starts[tile + 1]):
        k = members[member]
        left, right = span(place[k, 0], half[k, 0], width)
        top, bottom = span(place[k, 1], half[k, 1], height)
        for i in range(max(top, upper), min(bottom + 1, lower)):
            dy = i + 0.5 - place[k, 1]
            for j in range(max(left, begin), min(right + 1, end)):
                dx = j + 0.5 - place[k, 0]
                beta = 0.5 * (form[k, 0] * dx * dx + form[k, 2] * dy * dy) + form[k, 1] * dx * dy
                if beta > cutoff:
                    continue
                z = depth_at(position[k], normal[k], reach[k], j + 0.5, i + 0.5, lens)
                slot = layers
                while slot > 0 and z < depth[i, j, slot - 1]:
                    slot -= 1
                if slot == layers:
                    continue
                for later in range(layers - 1, slot, -1):
                    index[i, j, later] = index[i, j, later - 1]
                    depth[i, j, later] = depth[i, j, later - 1]
                    rho[i, j, later] = rho[i, j, later - 1]
                index[i, j, slot], depth[i, j, slot] = k, z
                rho[i, j, slot] = peak[k] * math.exp(-beta)
    for i in range(upper, lower):
        for j in range(begin, end):
            while front[i, j] < layers and depth[i, j, front[i, j]] - depth[i, j, 0] <= limit:
                front[i, j] += 1
