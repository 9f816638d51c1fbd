"""The gradient of positions through changes of visibility (Eq. 3.9 to 3.13), over all pixels.

Each pixel with a gradient affects every splat, at any distance. A splat that is not visible there is
pulled towards the pixel, and to the front; a visible one that increases the loss is pushed away. Pixels near a splat
count one by one, farther ones in blocks: see :mod:`.blocks`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ...learned.compiled.pool import in_parts
from ...learned.compiled.threads import in_use
from .blocks import LEAF, of_block, pyramid
from .camera import Camera
from .changes import change_with, change_without, entry_of, of_hidden, per_pixel
from .ellipses import Ellipses
from .raster import Lists, span
from .settings import Drawing

RAGGED = 4.0  # blocks at the border of a window are at most its size over this
FAINT = 30.0  # beta above which a Gaussian is negligible


@njit(cache=True, error_model="numpy")
def _guarded(value, by):
    return value + by if value >= 0 else value - by


@njit(nogil=True, cache=True, error_model="numpy")
def _gradient(begin, end, ellipses, lists, pixels, active, blocks, attributes, lens, how, opening, back):
    for k in range(begin, end):
        _of_splat(k, ellipses, lists, pixels, active, blocks, attributes, lens, how, opening, back)


@njit(cache=True, error_model="numpy")
def _of_splat(k, ellipses, lists, pixels, active, blocks, attributes, lens, how, opening, back):
    shown, place, position, _, form, half, peak, _ = ellipses
    index, depth, rho, front = lists
    pull, of_entries, of_image, total = pixels
    epsilon, limit, occlusion, typical, window = how
    starts, shapes, count, classes, sums = blocks
    fx, fy, skew, _, _ = lens
    height, width = active.shape
    top = len(shapes) - 1
    if not shown[k]:
        return
    u, v, z = place[k, 0], place[k, 1], position[k, 2]
    pixel_size, radius = z / math.sqrt(fx * fy), max(half[k, 0], half[k, 1])
    gx, gy, gz = 0.0, 0.0, 0.0
    # (level, row, column) of blocks still to visit: at most three siblings on each level wait
    waiting = np.empty((4 * (top + 2), 3), np.int64)
    waiting[0, 0], waiting[0, 1], waiting[0, 2] = top, 0, 0
    left = 1
    while left:
        left -= 1
        level, row, column = waiting[left]
        block = starts[level] + row * shapes[level, 1] + column
        if count[block] == 0:
            continue
        size = LEAF << level
        off_x = abs((column + 0.5) * size - place[k, 0])
        off_y = abs((row + 0.5) * size - place[k, 1])
        far = max(off_x, off_y)
        if far > window + 0.5 * size:
            continue
        crossed = far > window - 0.5 * size
        if crossed and opening > 0 and RAGGED * size <= window:  # small blocks are within the window, or beyond
            if far > window:
                continue
            crossed = False
        whole = opening > 0 and far >= opening * size and not crossed
        touches = off_x <= 0.5 * size + half[k, 0] and off_y <= 0.5 * size + half[k, 1]
        if whole and not touches:
            for number in range(count[block]):
                which = classes[block, number]
                ax, ay, az = of_block(
                    k,
                    u,
                    v,
                    z,
                    peak[k],
                    pixel_size,
                    sums,
                    block,
                    which,
                    attributes,
                    epsilon,
                    limit,
                    occlusion,
                    typical,
                )
                gx, gy, gz = gx + ax, gy + ay, gz + az
        elif level > 0:
            for row_below in range(2 * row, min(2 * row + 2, shapes[level - 1, 0])):
                for column_below in range(2 * column, min(2 * column + 2, shapes[level - 1, 1])):
                    waiting[left, 0], waiting[left, 1], waiting[left, 2] = level - 1, row_below, column_below
                    left += 1
        else:
            for i in range(row * LEAF, min(row * LEAF + LEAF, height)):
                for j in range(column * LEAF, min(column * LEAF + LEAF, width)):
                    if not active[i, j]:
                        continue
                    dx, dy, of_own, entry = j + 0.5 - u, i + 0.5 - v, 0.0, -1
                    if crossed and max(abs(dx), abs(dy)) > window:
                        continue
                    for c in range(attributes.shape[1]):
                        of_own += pull[i, j, c] * attributes[k, c]
                    if abs(dx) <= half[k, 0] and abs(dy) <= half[k, 1]:
                        entry = entry_of(k, i, j, index)
                    squared = dx * dx + dy * dy + epsilon
                    if entry >= front[i, j]:
                        if occlusion:
                            gz += of_hidden(i, j, entry, pixel_size, of_own, depth, rho, of_image, total, epsilon)
                    elif entry >= 0:
                        change = change_without(i, j, entry, index, depth, rho, front, of_entries, of_image, limit)
                        if change < 0:  # it can leave on either side
                            away = math.sqrt(squared)
                            change *= 1 / _guarded(away * (away + radius), epsilon) + 1 / _guarded(
                                away * (away - radius), epsilon
                            )
                            gx += change * dx
                            gy += change * dy
                    else:
                        change = change_with(
                            i, j, z, peak[k], of_own, depth, rho, front, of_entries, of_image, total, limit
                        )
                        if change < 0:
                            gx += change / squared * dx
                            gy += change / squared * dy
                            if occlusion and z - depth[i, j, 0] > limit:
                                dz = depth[i, j, 0] - z
                                gz += change * dz / (squared * pixel_size * pixel_size + dz * dz)
    back[k, 0], back[k, 1], back[k, 2] = gx * fx / z, (gx * skew + gy * fy) / z, gz


@njit(nogil=True, cache=True, error_model="numpy")
def _gaussian_gradient(begin, end, ellipses, lists, pixels, active, attributes, lens, how, back):
    """The gradient of the Gaussians, which are local: pixels beyond FAINT are ignored."""
    for k in range(begin, end):
        _of_gaussian(k, ellipses, lists, pixels, active, attributes, lens, how, back)


@njit(cache=True, error_model="numpy")
def _of_gaussian(k, ellipses, lists, pixels, active, attributes, lens, how, back):
    shown, place, position, _, form, half, peak, _ = ellipses
    index, depth, rho, front = lists
    pull, of_entries, of_image, total = pixels
    limit, cutoff = how
    fx, fy, skew, _, _ = lens
    height, width = active.shape
    far = math.sqrt(FAINT / cutoff)
    if not shown[k]:
        return
    u, v, z = place[k, 0], place[k, 1], position[k, 2]
    gx, gy = 0.0, 0.0
    left, right = span(u, far * half[k, 0], width)
    top, bottom = span(v, far * half[k, 1], height)
    for i in range(top, bottom + 1):
        for j in range(left, right + 1):
            if not active[i, j]:
                continue
            of_own = 0.0
            for c in range(attributes.shape[1]):
                of_own += pull[i, j, c] * attributes[k, c]
            entry = entry_of(k, i, j, index)
            if entry >= front[i, j]:
                continue
            if entry >= 0:
                change = -min(change_without(i, j, entry, index, depth, rho, front, of_entries, of_image, limit), 0.0)
            else:
                change = min(
                    change_with(i, j, z, peak[k], of_own, depth, rho, front, of_entries, of_image, total, limit),
                    0.0,
                )
            dx, dy = j + 0.5 - u, i + 0.5 - v
            mx, my = form[k, 0] * dx + form[k, 1] * dy, form[k, 1] * dx + form[k, 2] * dy
            change *= math.exp(-0.5 * (dx * mx + dy * my))
            gx += change * mx
            gy += change * my
    back[k, 0], back[k, 1] = gx * fx / z, (gx * skew + gy * fy) / z


def visibility_gradient(
    ellipses: Ellipses,
    lists: Lists,
    total: np.ndarray,
    image: np.ndarray,
    attributes: np.ndarray,
    gradient: np.ndarray,
    camera: Camera,
    how: Drawing,
) -> np.ndarray:
    """The gradient of the positions.

    Parameters
    ----------
    ellipses : Ellipses
    lists : Lists
    total : (h, w) float64 array
        The sum of the weights of each pixel.
    image, gradient : (h, w, c) float64 arrays
        The image, and the derivative of the loss by it.
    attributes : (n, c) float64 array
    camera : Camera
    how : Drawing

    Returns
    -------
    (n, 3) float64 array
        In the world.
    """
    of_entries, of_image, active = per_pixel(lists.index, attributes, image, gradient)
    pixels = (gradient, of_entries, of_image, total)
    arguments, back = (tuple(ellipses), tuple(lists), pixels, active), np.zeros((len(ellipses.shown), 3))
    if how.gradient == "rbf":
        settings = (how.depth_limit, how.cutoff)
        in_parts(_gaussian_gradient, len(back), in_use(), *arguments, attributes, camera.lens(), settings, back)
    else:
        peaks = ellipses.peak[ellipses.shown]
        typical = float(np.median(peaks)) if len(peaks) else 1.0
        blocks = pyramid(gradient, of_image, total, lists.depth, lists.front, active, typical)
        numbers = (how.epsilon, how.depth_limit, how.occlusion, typical, how.window or math.inf)
        settings = (camera.lens(), numbers, float(how.opening))
        in_parts(_gradient, len(back), in_use(), *arguments, blocks, attributes, *settings, back)
    return back @ camera.rotation
