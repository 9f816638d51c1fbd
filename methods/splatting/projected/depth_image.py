"""Images of points by projection: sums of smoothed depth values, with gradients to visible points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit


class Blur(NamedTuple):
    """The settings of drawing."""

    sigma: float
    """Standard deviation of a point's Gaussian, in pixels; it is cut off at twice that"""
    limit: float
    """Points this far behind the nearest point of a pixel are hidden there, in the unit of the points"""


@njit(cache=True)
def draw(place, depth, value, size, blur):
    """The image of points.

    A pixel is the sum of the values of the points visible there, each times a Gaussian; if the Gaussians sum
    to more than 1, it is their weighted mean.

    Parameters
    ----------
    place : (n, 2) float64 array
        Column and row.
    depth, value : (n,) float64 arrays
        The values of depths; points whose depth is not above 0 are left out.
    size : (int, int)
        Width and height.
    blur : Blur

    Returns
    -------
    image, total, nearest : (h, w) float64 arrays
        ``total`` are the sums of Gaussians.
    """
    width, height = size
    sigma, limit = blur
    image, total = np.zeros((height, width)), np.zeros((height, width))
    nearest = np.full((height, width), np.inf)
    for fill in range(2):
        for k in range(len(place)):
            if not depth[k] > 0:
                continue
            left, right, top, bottom = _window(place[k], 2 * sigma, width, height)
            for i in range(top, bottom):
                for j in range(left, right):
                    square = (j + 0.5 - place[k, 0]) ** 2 + (i + 0.5 - place[k, 1]) ** 2
                    if square > 4 * sigma * sigma:
                        continue
                    if not fill:
                        nearest[i, j] = min(nearest[i, j], depth[k])
                    elif depth[k] <= nearest[i, j] + limit:
                        weight = math.exp(-0.5 * square / (sigma * sigma))
                        image[i, j] += weight * value[k]
                        total[i, j] += weight
    for i in range(height):
        for j in range(width):
            image[i, j] /= max(total[i, j], 1.0)
    return image, total, nearest


@njit(cache=True)
def draw_back(place, depth, value, blur, drawn, slope):
    """The gradients by ``place`` (n, 2) and ``value`` (n,) from those by the image; ``drawn`` is the output of draw."""
    image, total, nearest = drawn
    height, width = image.shape
    sigma, limit = blur
    by_place, by_value = np.zeros((len(place), 2)), np.zeros(len(place))
    for k in range(len(place)):
        if not depth[k] > 0:
            continue
        left, right, top, bottom = _window(place[k], 2 * sigma, width, height)
        for i in range(top, bottom):
            for j in range(left, right):
                dx, dy = j + 0.5 - place[k, 0], i + 0.5 - place[k, 1]
                square = dx * dx + dy * dy
                if square > 4 * sigma * sigma or depth[k] > nearest[i, j] + limit:
                    continue
                weight = math.exp(-0.5 * square / (sigma * sigma))
                share = slope[i, j] / max(total[i, j], 1.0)
                by_value[k] += share * weight
                change = value[k] - (image[i, j] if total[i, j] > 1 else 0.0)
                by_place[k, 0] += share * change * weight * dx / (sigma * sigma)
                by_place[k, 1] += share * change * weight * dy / (sigma * sigma)
    return by_place, by_value


@njit(cache=True)
def _window(place, reach, width, height):
    left, right = max(math.ceil(place[0] - reach - 0.5), 0), min(math.floor(place[0] + reach - 0.5), width - 1)
    top, bottom = max(math.ceil(place[1] - reach - 0.5), 0), min(math.floor(place[1] + reach - 0.5), height - 1)
    return int(left), int(right) + 1, int(top), int(bottom) + 1
