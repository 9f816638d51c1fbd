"""How well shaped triangles are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class TriangleQuality(NamedTuple):
    """Three measures of each of f triangles."""

    radius_ratio: np.ndarray
    """(f,) array in 0..1: twice the inscribed by the circumscribed radius; 1 is equilateral, 0 degenerate"""
    min_angle: np.ndarray
    """(f,) array in 0..60 degrees"""
    aspect_ratio: np.ndarray
    """(f,) array, 1 (equilateral) to infinity: longest edge by shortest altitude, times sqrt(3) / 2"""


def triangle_quality(vertices: np.ndarray, faces: np.ndarray) -> TriangleQuality:
    """The quality of each triangle of a mesh; degenerate ones have ratio 0, angle 0 and an infinite aspect ratio.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (f, 3) int array

    Example
    -------
    >>> import numpy as np
    >>> V = np.array([[0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0]])
    >>> [round(float(q[0]), 6) for q in triangle_quality(V, np.array([[0, 1, 2]]))]
    [1.0, 60.0, 1.0]
    """
    a, b, c = np.moveaxis(np.asarray(vertices, dtype=np.float64)[np.asarray(faces)], 1, 0)
    edges = np.sort(np.stack([np.linalg.norm(e, axis=1) for e in (b - c, c - a, a - b)], axis=1), axis=1)
    short, middle, long = edges.T
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)  # twice the area
    flat = doubled <= 1e-14 * long**2  # what rounding leaves of a degenerate triangle
    product, perimeter = short * middle * long, edges.sum(axis=1)
    # r = 2 area / perimeter and R = abc / (4 area), so 2 r / R = 16 area^2 / (abc perimeter).
    scale = np.where(flat, 1.0, product * perimeter)
    radius_ratio = np.where(flat, 0.0, 4 * doubled**2 / scale)
    # The smallest angle is opposite the shortest edge: tan = |u x w| / u . w keeps its digits where arccos loses them.
    between = (middle**2 + long**2 - short**2) / 2
    min_angle = np.where(flat, 0.0, np.degrees(np.arctan2(doubled, between)))
    # The shortest altitude is the one on the longest edge: 2 area / long.
    aspect = np.where(flat, np.inf, long**2 / np.where(flat, 1.0, doubled) * np.sqrt(0.75))
    return TriangleQuality(radius_ratio, min_angle, aspect)
