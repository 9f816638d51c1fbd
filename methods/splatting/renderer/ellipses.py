"""Oriented points as ellipses of the image: elliptical weighted averages (Zwicker et al. 2001; Eq. 3.4 to 3.6)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ...learned.compiled.pool import in_parts
from ...learned.compiled.threads import in_use
from .camera import Camera
from .settings import Drawing

TINY = 1e-300


class Ellipses(NamedTuple):
    """The ellipses of points in an image; entries of points that are not drawn are meaningless."""

    shown: np.ndarray
    """(n,) bool array"""
    place: np.ndarray
    """(n, 2) float64 array: column and row of the centre, continuous"""
    position: np.ndarray
    """(n, 3) float64 array: in the axes of the camera"""
    normal: np.ndarray
    """(n, 3) float64 array: the same, towards the camera"""
    form: np.ndarray
    """(n, 3) float64 array: M_00, M_01, M_11 of the inverse variance"""
    half: np.ndarray
    """(n, 2) float64 array: half the extent of the covered pixels, in columns and rows"""
    peak: np.ndarray
    """(n,) float64 array: its weight at the centre"""
    reach: np.ndarray
    """(n,) float64 array: no part of it is farther from the centre in depth"""


def project(points: np.ndarray, normals: np.ndarray, sigma: np.ndarray, camera: Camera, how: Drawing) -> Ellipses:
    """The ellipses of points.

    Parameters
    ----------
    points, normals : (n, 3) float64 arrays
        In the world; normals of unit length.
    sigma : (n,) float64 array
        Standard deviation of each point's Gaussian in its tangent plane.
    camera : Camera
    how : Drawing
    """
    position, normal = camera.to_camera(points), normals @ camera.rotation.T
    settings = (how.cutoff, how.blur, how.cull, how.grazing, how.near)
    frame = (*camera.lens(), float(camera.width), float(camera.height))
    n = len(position)
    shown, place, form = np.zeros(n, np.bool_), np.zeros((n, 2)), np.zeros((n, 3))
    rest = np.zeros((n, 2)), np.zeros(n), np.zeros(n)
    ellipses = Ellipses(shown, place, position, np.ascontiguousarray(normal), form, *rest)
    in_parts(_project, len(sigma), in_use(), tuple(ellipses), np.asarray(sigma, np.float64), frame, settings)
    return ellipses


@njit(nogil=True, cache=True)
def _project(begin, end, ellipses, sigma, frame, settings):
    for k in range(begin, end):
        _project_one(k, ellipses, sigma, frame, settings)


@njit(cache=True)
def _project_one(k, ellipses, sigma, frame, settings):
    """Fill the row of a point; normals are turned to the camera."""
    shown, place, position, normal, form, half, peak, reach = ellipses
    fx, fy, skew, cx, cy, width, height = frame
    cutoff, blur, cull, grazing, near = settings
    x, y, z = position[k, 0], position[k, 1], position[k, 2]
    a, b, c = normal[k, 0], normal[k, 1], normal[k, 2]
    towards = -(a * x + b * y + c * z)
    length = math.sqrt(x * x + y * y + z * z)
    if towards < 0 and not cull:
        towards = -towards
        for axis in range(3):
            normal[k, axis] = -normal[k, axis]
    if not (z > near and towards >= grazing * length):
        return
    u, v = (fx * x + skew * y) / z + cx, fy * y / z + cy
    if not (-0.5 * width <= u <= 1.5 * width and -0.5 * height <= v <= 1.5 * height):
        return
    # Rows of the Jacobian of the projection, and of it times the normal: A (1 - n n^T) A^T
    ax, ay, az = fx / z, skew / z, -(fx * x + skew * y) / (z * z)
    by, bz = fy / z, -fy * y / (z * z)
    an = ax * normal[k, 0] + ay * normal[k, 1] + az * normal[k, 2]
    bn = by * normal[k, 1] + bz * normal[k, 2]
    variance = sigma[k] * sigma[k]
    s00 = variance * max(ax * ax + ay * ay + az * az - an * an, 0.0) + blur * blur
    s01 = variance * (ay * by + az * bz - an * bn)
    s11 = variance * max(by * by + bz * bz - bn * bn, 0.0) + blur * blur
    determinant = s00 * s11 - s01 * s01
    if not determinant > TINY:
        return
    shown[k] = True
    place[k, 0], place[k, 1] = u, v
    form[k, 0], form[k, 1], form[k, 2] = s11 / determinant, -s01 / determinant, s00 / determinant
    half[k, 0], half[k, 1] = math.sqrt(2 * cutoff * s00), math.sqrt(2 * cutoff * s11)
    peak[k] = fx * fy * towards / (z * z * z) / (2 * math.pi * math.sqrt(determinant))
    reach[k] = sigma[k] * math.sqrt(2 * cutoff)
