"""Photo-consistency: whether the colours of a voxel in several views can be those of one surface point."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit

from bench import Views
from bench.geometry.spiral import golden_spiral

CANDIDATES = 200  # start directions of the search for a normal: within 8 degrees of any
STEPS = 5  # Gauss-Newton steps from the best of them
STRAY = 0.2  # RMS error of a colour above which a view counts as seeing another surface


def shades(directions: np.ndarray, lights: np.ndarray, colors: np.ndarray, ambient: np.ndarray) -> np.ndarray:
    """Diffuse shading of normals (d, 3) under the lights (v, k, 3) of each view: (v, d, 3) float64 array, 0 to 1."""
    facing = np.maximum(np.einsum("di,vki->vdk", directions, lights), 0)
    return np.minimum(facing @ colors + ambient[:, None], 1)


def agreement(views: Views, share: float, reach: int) -> Callable[[np.ndarray], np.ndarray]:
    """The disagreement of the colours of voxels, as a function of the pixels (n, v) in which the views see them.

    With known lights it is the error of a colour, RMS over the three channels, for the normal that explains the views
    best: that of the worst of the best ``share`` of the views. Without lights, it is the standard deviation of the
    colours of the same number of views, those nearest to the median, RMS over the channels.

    Parameters
    ----------
    views : Views
    share : float
    reach : int
        With known lights: the best pixel within this number of rows and columns counts as the colour of a view.
    """
    images = np.ascontiguousarray(views.images.reshape(len(views), -1, 3))
    if views.light_directions is None or views.light_colors is None:
        return lambda pixels: one_color(pixels, images, share)
    ambient = np.zeros((len(views), 3)) if views.ambient is None else views.ambient
    directions = golden_spiral(CANDIDATES)
    table = shades(directions, views.light_directions, views.light_colors, ambient)
    known = (views.light_directions, views.light_colors, ambient, directions, table)
    # Writeable, because the loops are compiled for writeable arrays.
    lights, colors, ambient, directions, table = (np.array(array, order="C") for array in known)
    return lambda pixels: one_normal(
        pixels, images, lights, colors, ambient, directions, table, float(share), views.width, int(reach)
    )


@njit(cache=True, nogil=True)
def one_normal(pixels, images, lights, colors, ambient, directions, table, share, width, reach):
    """See :func:`agreement`; 0 where no view sees the voxel."""
    count, most = pixels.shape
    found = np.zeros(count)
    views, errors, seen = np.empty(most, dtype=np.int64), np.empty(most), np.empty((most, 3))
    for k in range(count):
        m = _gather(pixels[k], images, views, seen)
        if m == 0:
            continue
        best, least = 0, np.inf
        for d in range(len(directions)):
            total = 0.0
            for s in range(m):
                total += min(_square(table[views[s], d], seen[s]), STRAY * STRAY)
                if total >= least:
                    break
            if total < least:
                best, least = d, total
        normal = directions[best].copy()
        shade = np.empty(3)
        for _ in range(STEPS):
            least = _improve(normal, least, views[:m], seen, lights, colors, ambient, shade)
        for s in range(m):
            _shade(normal, lights[views[s]], colors[views[s]], ambient[views[s]], shade)
            square, at = _nearest(shade, images[views[s]], pixels[k, views[s]], width, reach), s
            while at > 0 and errors[at - 1] > square:  # in order, the least one first
                errors[at] = errors[at - 1]
                at -= 1
            errors[at] = square
        found[k] = math.sqrt(errors[math.ceil(share * m) - 1])
    return found


def one_color(pixels: np.ndarray, images: np.ndarray, share: float) -> np.ndarray:
    """See :func:`agreement`; 0 where no view sees the voxel."""
    seen = pixels >= 0
    colors = np.where(seen[..., None], images[np.arange(len(images)), np.maximum(pixels, 0)] / 255, np.nan)
    square = np.full(pixels.shape, np.inf)
    voxels = seen.any(axis=1)
    square[voxels] = ((colors[voxels] - np.nanmedian(colors[voxels], axis=1, keepdims=True)) ** 2).mean(axis=2)
    order = np.argsort(np.where(seen, square, np.inf), axis=1, kind="stable")
    colors = np.take_along_axis(colors, order[..., None], axis=1)
    colors[np.arange(colors.shape[1]) >= np.ceil(share * seen.sum(axis=1))[:, None]] = np.nan
    found = np.zeros(len(pixels))
    found[voxels] = np.sqrt(np.nanvar(colors[voxels], axis=1).mean(axis=1))
    return found


@njit(cache=True, nogil=True, inline="always")
def _gather(pixels, images, views, seen):
    """The views that see a voxel, and the colours there, 0 to 1; returns their number."""
    m = 0
    for v in range(len(pixels)):
        if pixels[v] >= 0:
            views[m] = v
            for c in range(3):
                seen[m, c] = images[v, pixels[v], c] / 255
            m += 1
    return m


@njit(cache=True, nogil=True, inline="always")
def _square(one, other):
    """The mean square of the difference of two colours."""
    return ((one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2 + (one[2] - other[2]) ** 2) / 3


@njit(cache=True, nogil=True)
def _nearest(color, image, pixel, width, reach):
    """The least :func:`_square` of a colour to a pixel and those around it, up to ``reach`` rows and columns away."""
    least = np.inf
    row, column = pixel // width, pixel % width
    for i in range(max(row - reach, 0), min(row + reach + 1, len(image) // width)):
        for j in range(max(column - reach, 0), min(column + reach + 1, width)):
            square = 0.0
            for c in range(3):
                square += (image[i * width + j, c] / 255 - color[c]) ** 2 / 3
            least = min(least, square)
    return least


@njit(cache=True, nogil=True)
def _shade(normal, lights, colors, ambient, shade):
    for c in range(3):
        shade[c] = ambient[c]
    for k in range(len(lights)):
        facing = normal[0] * lights[k, 0] + normal[1] * lights[k, 1] + normal[2] * lights[k, 2]
        if facing > 0:
            for c in range(3):
                shade[c] += facing * colors[k, c]
    for c in range(3):
        shade[c] = min(shade[c], 1.0)


@njit(cache=True, nogil=True)
def _improve(normal, least, views, seen, lights, colors, ambient, shade):
    """A Gauss-Newton step on the sphere, halved until the sum of squares falls below ``least``; returns that sum.

    Views with an error of ``STRAY`` or more are ignored, and lights behind the surface have no slope.
    """
    square, side, slope = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    for a in range(3):  # loops: array expressions take many times as long to compile
        square[a, a] = 1e-6
    for s in range(len(views)):
        v = views[s]
        _shade(normal, lights[v], colors[v], ambient[v], shade)
        if _square(shade, seen[s]) > STRAY * STRAY:
            continue
        for c in range(3):
            if shade[c] >= 1.0:
                continue
            for a in range(3):
                slope[a] = 0.0
            for k in range(lights.shape[1]):
                if normal[0] * lights[v, k, 0] + normal[1] * lights[v, k, 1] + normal[2] * lights[v, k, 2] > 0:
                    for a in range(3):
                        slope[a] += lights[v, k, a] * colors[v, k, c]
            along = slope[0] * normal[0] + slope[1] * normal[1] + slope[2] * normal[2]
            for a in range(3):
                slope[a] -= normal[a] * along
            for a in range(3):
                side[a] += slope[a] * (seen[s, c] - shade[c])
                for b in range(3):
                    square[a, b] += slope[a] * slope[b]
    # Cramer's rule: the rows of the adjugate are cross products, by the determinant
    yz, zx, xy = _cross(square[1], square[2]), _cross(square[2], square[0]), _cross(square[0], square[1])
    volume = square[0, 0] * yz[0] + square[0, 1] * yz[1] + square[0, 2] * yz[2]
    step, trial = np.empty(3), np.empty(3)
    for a in range(3):
        step[a] = (side[0] * yz[a] + side[1] * zx[a] + side[2] * xy[a]) / volume
    for _ in range(4):
        for a in range(3):
            trial[a] = normal[a] + step[a]
        length = math.sqrt(trial[0] ** 2 + trial[1] ** 2 + trial[2] ** 2)
        for a in range(3):
            trial[a] /= length
        total = 0.0
        for s in range(len(views)):
            v = views[s]
            _shade(trial, lights[v], colors[v], ambient[v], shade)
            total += min(_square(shade, seen[s]), STRAY * STRAY)
        if total < least:
            for a in range(3):
                normal[a] = trial[a]
            return total
        for a in range(3):
            step[a] *= 0.5
    return least


@njit(cache=True, nogil=True, inline="always")
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
