"""Colours of pixels from those of the splats that they show (Eq. 3.8), and back."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

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
        Both are 0 where nothing is.
    """
    return _blend(lists.index, lists.rho, lists.front, attributes)


@njit(parallel=True, cache=True)
def _blend(index, rho, front, attributes):
    height, width, _ = index.shape
    channels = attributes.shape[1]
    image, total = np.zeros((height, width, channels)), np.zeros((height, width))
    for i in prange(height):
        for j in range(width):
            for entry in range(front[i, j]):
                total[i, j] += rho[i, j, entry]
                for c in range(channels):
                    image[i, j, c] += rho[i, j, entry] * attributes[index[i, j, entry], c]
            if total[i, j] > 0:
                for c in range(channels):
                    image[i, j, c] /= total[i, j]
    return image, total


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
