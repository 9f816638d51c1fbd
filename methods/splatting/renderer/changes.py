"""The change of a pixel when a splat moves onto it, or leaves it: the cases of figure 3.17.

All numbers are derivatives of the loss times the change of the pixel's colours, summed over channels; positive ones
are discarded (Eq. 3.13).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ...learned.compiled.pool import in_parts
from ...learned.compiled.threads import in_use


def per_pixel(
    index: np.ndarray, attributes: np.ndarray, image: np.ndarray, gradient: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The gradient times the attributes of the entries, and times the image; and whether it is not 0."""
    of_entries, of_image, active = np.zeros(index.shape), np.zeros(index.shape[:2]), np.zeros(index.shape[:2], np.bool_)
    in_parts(_per_row, len(index), in_use(), index, attributes, image, gradient, of_entries, of_image, active)
    return of_entries, of_image, active


@njit(nogil=True, cache=True, error_model="numpy")
def _per_row(begin, end, index, attributes, image, gradient, of_entries, of_image, active):
    for i in range(begin, end):
        _of_row(index[i], attributes, image[i], gradient[i], of_entries[i], of_image[i], active[i])


@njit(cache=True, error_model="numpy")
def _of_row(index, attributes, image, gradient, of_entries, of_image, active):
    for j in range(len(index)):
        for c in range(gradient.shape[1]):
            active[j] |= gradient[j, c] != 0
            of_image[j] += gradient[j, c] * image[j, c]
            for entry in range(index.shape[1]):
                if index[j, entry] >= 0:
                    of_entries[j, entry] += gradient[j, c] * attributes[index[j, entry], c]


@njit(cache=True, error_model="numpy")
def entry_of(k, i, j, index):
    """The place of a splat in the list of a pixel, or -1."""
    for entry in range(index.shape[2]):
        if index[i, j, entry] == k:
            return entry
    return -1


@njit(cache=True, error_model="numpy")
def of_hidden(i, j, entry, pixel_size, of_own, depth, rho, of_image, total, epsilon):
    """Case (b) of a splat that covers the pixel, behind others: the derivative by its depth, to the front."""
    weight = rho[i, j, entry]
    change = weight * (of_own - of_image[i, j]) / (total[i, j] + weight)
    if not change < 0:
        return 0.0
    return change / (depth[i, j, 0] - depth[i, j, entry] - math.sqrt(epsilon) * pixel_size)


@njit(cache=True, error_model="numpy")
def change_without(i, j, entry, index, depth, rho, front, of_entries, of_image, limit):
    """Case (c): the first-order change of the loss when a visible splat leaves the pixel."""
    weight, value, seen = 0.0, 0.0, front[i, j]
    for e in range(seen):
        if e != entry:
            weight += rho[i, j, e]
            value += rho[i, j, e] * of_entries[i, j, e]
    if seen == 1:  # the next layer appears
        for e in range(1, index.shape[2]):
            if index[i, j, e] >= 0 and depth[i, j, e] - depth[i, j, 1] <= limit:
                weight += rho[i, j, e]
                value += rho[i, j, e] * of_entries[i, j, e]
    return (value / weight if weight > 0 else 0.0) - of_image[i, j]


@njit(cache=True, error_model="numpy")
def change_with(i, j, z, peak, of_own, depth, rho, front, of_entries, of_image, total, limit):
    """Cases (a) and (b): the first-order change of the loss when a splat moves onto the pixel."""
    change, weight, seen = of_own - of_image[i, j], total[i, j], front[i, j]
    if seen > 0 and depth[i, j, seen - 1] - limit > z:  # it would hide some visible splats
        weight, value = 0.0, 0.0
        for e in range(seen):
            if depth[i, j, e] - limit <= z:
                weight += rho[i, j, e]
                value += rho[i, j, e] * (of_entries[i, j, e] - of_image[i, j])
        return (peak * change + value) / (peak + weight)
    if not change < 0:
        return 0.0
    return peak * change / (peak + weight)
