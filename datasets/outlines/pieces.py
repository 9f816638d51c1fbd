"""From points to closed curves of cubic Bezier pieces: splines, polygons with round corners."""

from __future__ import annotations

import numpy as np


def spline(points: np.ndarray) -> np.ndarray:
    """The closed cubic spline through ``points`` (n, 2), twice differentiable: (n, 4, 2) control points.

    Its parameter is the length of the chords.
    """
    from scipy.interpolate import CubicSpline

    closed = np.concatenate([points, points[:1]])
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    slopes = CubicSpline(knots, closed, bc_type="periodic")(knots, 1)
    third = np.diff(knots)[:, None] / 3
    begin, end = closed[:-1], closed[1:]
    return np.stack([begin, begin + third * slopes[:-1], end - third * slopes[1:], end], axis=1)


def polygon(corners: np.ndarray, rounding: float) -> np.ndarray:
    """A closed polygon through ``corners`` (n, 2): straight sides, and a bend at each corner.

    Parameters
    ----------
    corners : (n, 2) array, counter-clockwise
    rounding : float
        The share of half a side that a bend uses, of the shorter of its two sides; 0 for sharp corners, below 1.

    Returns
    -------
    (n or 2 n, 4, 2) array
        Tangents are continuous where ``rounding`` is above 0.
    """
    ahead = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(ahead, axis=1)
    along = ahead / lengths[:, None]
    cut = rounding * np.minimum(lengths, np.roll(lengths, 1)) / 2
    starts = corners + cut[:, None] * along  # of the side after each corner
    ends = np.roll(corners - cut[:, None] * np.roll(along, 1, axis=0), -1, axis=0)
    sides = starts[:, None] + np.linspace(0, 1, 4)[:, None] * (ends - starts)[:, None]
    if not rounding:
        return sides
    # Handles of 0.55 of the cut: near a quarter of a circle where the corner is a right angle.
    after = np.roll(corners, -1, axis=0), np.roll(starts, -1, axis=0)
    handles = [point + 0.55 * (after[0] - point) for point in (ends, after[1])]
    bends = np.stack([ends, *handles, after[1]], axis=1)
    return np.stack([sides, bends], axis=1).reshape(-1, 4, 2)


def turned(curve: np.ndarray) -> np.ndarray:
    """The curve (m, 4, 2) in reverse direction."""
    return curve[::-1, ::-1]


def area(curve: np.ndarray) -> float:
    """The approximate area in a curve (m, 4, 2), by the ends of its pieces; positive if it is counter-clockwise."""
    x, y = curve[:, 0].T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def normalised(curves: list[np.ndarray]) -> list[np.ndarray]:
    """The curves with the middle of their box at the origin, and the farthest point at about 1."""
    t = np.linspace(0, 1, 9)[:, None]
    weights = np.concatenate([(1 - t) ** 3, 3 * (1 - t) ** 2 * t, 3 * (1 - t) * t**2, t**3], axis=1)
    points = np.concatenate([np.einsum("tk,mki->mti", weights, curve).reshape(-1, 2) for curve in curves])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    size = np.linalg.norm(points - middle, axis=1).max()
    return [(curve - middle) / size for curve in curves]
