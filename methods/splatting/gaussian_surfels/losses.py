"""The losses of an image of surfels: colours, mask, depth distortion, and normals (Huang et al. 2024)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from ..renderer.camera import Camera
from .compositing import FEATURES

SUMS, DEPTHS = FEATURES, FEATURES + 1  # channels of the maps
SOLID = 0.5  # normals of depths are used if the weights of a pixel and of its neighbours each sum to more than this


@dataclass(frozen=True)
class Weighting:
    """The weights of the terms; the fields are parameters of the method."""

    mask_weight: float
    distortion: float
    consistency: float


def loss_of(
    maps: np.ndarray, wanted: np.ndarray, mask: np.ndarray, camera: Camera, weighting: Weighting
) -> tuple[float, np.ndarray]:
    """The loss of an image, the mean over its pixels, and its slopes by the maps.

    Parameters
    ----------
    maps : (h, w, 9) array
        See :class:`.rendering.Rendered`.
    wanted : (h, w, 3) array
        Colours, 0 to 1.
    mask : (h, w) bool array
    camera : Camera
    weighting : Weighting

    Returns
    -------
    float, (h, w, 9) float64 array
    """
    pixels = mask.size
    slopes = np.zeros(maps.shape)
    difference = maps[..., :3] - wanted
    slopes[..., :3] = np.sign(difference) / (3 * pixels)
    loss = np.abs(difference).mean()
    if weighting.mask_weight:
        missing = maps[..., SUMS] - mask
        loss += weighting.mask_weight * np.abs(missing).mean()
        slopes[..., SUMS] += weighting.mask_weight / pixels * np.sign(missing)
    if weighting.distortion:
        # The sum over pairs of w_i w_j (z_i - z_j)^2 is (sum w) (sum w z^2) - (sum w z)^2
        total, first, second = (maps[..., FEATURES + c] for c in range(3))
        loss += weighting.distortion * (total * second - first**2).mean()
        share = weighting.distortion / pixels
        slopes[..., SUMS] += share * second
        slopes[..., DEPTHS] -= 2 * share * first
        slopes[..., FEATURES + 2] += share * total
    if weighting.consistency:
        value = consistency(np.ascontiguousarray(maps), camera.lens(), weighting.consistency / pixels, slopes)
        loss += weighting.consistency / pixels * value
    return float(loss), slopes


@njit(cache=True)
def consistency(maps, lens, factor, slopes):
    """The sum over pixels of sum_i w_i (1 - n_i . N), N the normal of the mean depths; ``slopes`` receives its slopes.

    N is that of the plane through the four neighbours of a pixel (central differences), towards the camera. It counts
    if the weights of all five sum to more than ``SOLID``.
    """
    height, width, _ = maps.shape
    total = 0.0
    places = np.zeros((height, width, 3))
    for i in range(height):
        for j in range(width):
            if maps[i, j, SUMS] > SOLID:
                _put(places[i, j], maps[i, j], i + 0.5, j + 0.5, lens)
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            east, west, south, north = places[i, j + 1], places[i, j - 1], places[i + 1, j], places[i - 1, j]
            if places[i, j, 2] * east[2] * west[2] * south[2] * north[2] == 0:
                continue
            right = (east[0] - west[0], east[1] - west[1], east[2] - west[2])
            down = (south[0] - north[0], south[1] - north[1], south[2] - north[2])
            a, b, c = _cross(down, right)
            length = math.sqrt(a * a + b * b + c * c)
            if length < 1e-12:
                continue
            a, b, c = a / length, b / length, c / length
            x, y, z = maps[i, j, 3], maps[i, j, 4], maps[i, j, 5]
            cosine = x * a + y * b + z * c
            total += maps[i, j, SUMS] - cosine
            slopes[i, j, SUMS] += factor
            slopes[i, j, 3] -= factor * a
            slopes[i, j, 4] -= factor * b
            slopes[i, j, 5] -= factor * c
            share = -factor / length
            by_normal = (share * (x - a * cosine), share * (y - b * cosine), share * (z - c * cosine))
            by_right, by_down = _cross(by_normal, down), _cross(right, by_normal)
            _put_back(slopes[i, j + 1], maps[i, j + 1], east, by_right, 1.0)
            _put_back(slopes[i, j - 1], maps[i, j - 1], west, by_right, -1.0)
            _put_back(slopes[i + 1, j], maps[i + 1, j], south, by_down, 1.0)
            _put_back(slopes[i - 1, j], maps[i - 1, j], north, by_down, -1.0)
    return total


@njit(cache=True, inline="always")
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, inline="always")
def _put(place, pixel, row, column, lens):
    """The point on the ray of a pixel at its mean depth."""
    fx, fy, skew, cx, cy = lens
    depth = pixel[DEPTHS] / pixel[SUMS]
    y = (row - cy) / fy
    place[0], place[1], place[2] = depth * (column - cx - skew * y) / fx, depth * y, depth


@njit(cache=True, inline="always")
def _put_back(slope, pixel, place, by_place, sign):
    """Add the slopes by the sums of a pixel: the place moves along its ray with the mean depth."""
    along = sign * (by_place[0] * place[0] + by_place[1] * place[1] + by_place[2] * place[2]) / place[2]
    slope[DEPTHS] += along / pixel[SUMS]
    slope[SUMS] -= along * place[2] / pixel[SUMS]
