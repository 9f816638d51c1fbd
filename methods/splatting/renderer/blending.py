"""Colours of pixels from those of the splats that they show (Eq. 3.8), and their gradients."""

from __future__ import annotations

import numpy as np
from numba import njit

from ...learned.compiled.pool import in_parts
from ...learned.compiled.threads import in_use
from .raster import Lists


def blend(lists: Lists, attributes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The image, and the sum of the weights of each pixel.

    Parameters
    ----------
    lists : Lists
    attributes : (n, c) float64 array

    Returns
    -------
    (h, w, c), (h, w) float64 arrays
        Both are 0 in the background.
    """
    height, width, _ = lists.index.shape
    image, total = np.zeros((height, width, attributes.shape[1])), np.zeros((height, width))
    in_parts(_blend, len(image), in_use(), lists.index, lists.rho, lists.front, attributes, image, total)
    return image, total


@njit(nogil=True, cache=True)
def _blend(begin, end, index, rho, front, attributes, image, total):
    for i in range(begin, end):
        _blend_row(index[i], rho[i], front[i], attributes, image[i], total[i])


@njit(cache=True)
def _blend_row(index, rho, front, attributes, image, total):
    for j in range(len(image)):
        for entry in range(front[j]):
            total[j] += rho[j, entry]
            for c in range(attributes.shape[1]):
                image[j, c] += rho[j, entry] * attributes[index[j, entry], c]
        if total[j] > 0:
            for c in range(attributes.shape[1]):
                image[j, c] /= total[j]


def blend_back(lists: Lists, total: np.ndarray, gradient: np.ndarray, count: int) -> np.ndarray:
    """The gradient of the attributes (count, c), from that of the image (h, w, c)."""
    return _blend_back(lists.index, lists.rho, lists.front, total, gradient, count)


@njit(cache=True)
def _blend_back(index, rho, front, total, gradient, count):
    height, width, channels = gradient.shape
    back = np.zeros((count, channels))
    for i in range(height):
        for j in range(width):
            for entry in range(front[i, j]):
                if total[i, j] > 0:
                    share = rho[i, j, entry] / total[i, j]
                    for c in range(channels):
                        back[index[i, j, entry], c] += share * gradient[i, j, c]
    return back
