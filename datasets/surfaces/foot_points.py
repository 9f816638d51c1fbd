"""Newton's method for the foot points of points on a surface x(u, v), within bounds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .tangents import dot

ROUNDING = 1e-15  # of coordinates, relative to the size: no step is rejected for its effect on a squared distance


def refine(
    points: np.ndarray,
    start: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    longest: np.ndarray,
    size: float,
    evaluate: Callable[[np.ndarray, np.ndarray, int], np.ndarray],
    *,
    iterations: int = 60,
) -> tuple[np.ndarray, np.ndarray]:
    """Minimise ``|p - x(u, v)|^2`` from ``start``; the result is never farther away than the start.

    Parameters
    ----------
    points : (n, 3) array
    start, low, high : (n, 2) arrays
        Parameters to start from, and their bounds.
    longest : (n, 2) array
        The longest step.
    size : float
        Of the surface: the unit of the tolerance.
    evaluate : function of (rows, places, order) that returns Taylor coefficients (6, n, 3) of x

    Returns
    -------
    places : (n, 2) array
    squares : (n,) array of squared distances
    """
    result = np.clip(start, low, high)
    rows = np.arange(len(points))
    places, taylor = result, evaluate(rows, result, 2)
    squares = _square(points, taylor[0])
    damping, final = np.ones(len(points)), squares.copy()
    for _ in range(iterations):
        step, moved = _newton_step(points[rows] - taylor[0], taylor, places, low[rows], high[rows])
        shrink = np.minimum(1, (longest[rows] / np.maximum(np.abs(step), 1e-300)).min(axis=1)) * damping
        trial = np.clip(places + shrink[:, None] * step, low[rows], high[rows])
        # Convergence is quadratic, beside a pole only after some steps: the error is far below the last step.
        going = np.flatnonzero((moved * shrink > 1e-11 * size) & (damping > 1e-9))
        ended = np.setdiff1d(np.arange(len(rows)), going, assume_unique=True)
        if len(ended):  # the last step counts if it comes nearer
            last = rows[ended]
            square = _square(points[last], evaluate(last, trial[ended], 0)[0])
            better = square <= _tolerant(squares[ended], size)
            result[last] = np.where(better[:, None], trial[ended], places[ended])
            final[last] = np.where(better, square, squares[ended])
        if not len(going):
            return result, final
        rows, places, trial, squares, damping = (x[going] for x in (rows, places, trial, squares, damping))
        taylor = taylor[:, going]
        trial_taylor = evaluate(rows, trial, 2)
        trial_squares = _square(points[rows], trial_taylor[0])
        better = trial_squares <= _tolerant(squares, size)
        places = np.where(better[:, None], trial, places)
        taylor = np.where(better[:, None], trial_taylor, taylor)
        squares = np.where(better, trial_squares, squares)
        damping = np.where(better, np.minimum(1, 4 * damping), damping / 4)
        result[rows], final[rows] = places, squares
    return result, final


def _square(points: np.ndarray, x: np.ndarray) -> np.ndarray:
    square = ((points - x) ** 2).sum(axis=1)
    return np.where(np.isfinite(square), square, np.inf)


def _tolerant(squares: np.ndarray, size: float) -> np.ndarray:
    return squares + ROUNDING * (squares + np.sqrt(squares) * size)


def _newton_step(
    residual: np.ndarray, taylor: np.ndarray, places: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The step (n, 2) towards the minimum of ``|r|^2 / 2``, and its length along the surface, (n,).

    In parameters scaled to lengths, so that the step does not depend on the parametrisation.
    """
    _, x_u, x_v, x_uu, x_uv, x_vv = np.nan_to_num(taylor, nan=0.0, posinf=1e100, neginf=-1e100)
    scale = np.sqrt(np.stack([dot(x_u, x_u), dot(x_v, x_v)], axis=1))
    scale = np.maximum(scale, 1e-12 * scale.max(axis=1, keepdims=True) + 1e-200)
    s_u, s_v = scale.T
    g = -np.stack([dot(residual, x_u) / s_u, dot(residual, x_v) / s_v], axis=1)
    a = (dot(x_u, x_u) - 2 * dot(residual, x_uu)) / s_u**2
    b = (dot(x_u, x_v) - dot(residual, x_uv)) / (s_u * s_v)
    c = (dot(x_v, x_v) - 2 * dot(residual, x_vv)) / s_v**2
    # Where |r|^2 is not convex, shift its curvatures up: then the step is a descent step.
    lowest = (a + c) / 2 - np.hypot((a - c) / 2, b)
    shift = np.where(lowest < 1e-3, np.maximum(0.1, -lowest) - lowest, 0.0)
    a, c = a + shift, c + shift
    step = _box_minimum(a, b, c, g, (low - places) * scale, (high - places) * scale)
    return step / scale, np.linalg.norm(step, axis=1)


def _box_minimum(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, g: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """The minimum (n, 2) of convex functions ``g . s + (a s0^2 + 2 b s0 s1 + c s1^2) / 2`` over low <= s <= high."""
    determinant = a * c - b * b
    step = np.stack([b * g[:, 1] - c * g[:, 0], b * g[:, 0] - a * g[:, 1]], axis=1) / determinant[:, None]
    step = np.nan_to_num(step)
    crosses = (step < low) | (step > high)
    rows = np.flatnonzero(crosses.any(axis=1))
    if not len(rows):
        return step
    # If the free minimum lies beyond one bound, the bounded one is on that bound; beyond two, on one of them.
    a, b, c, g, low, high, free = (x[rows] for x in (a, b, c, g, low, high, step))
    best, lowest = np.clip(free, low, high), np.full(len(rows), np.inf)
    for k, own in ((0, a), (1, c)):
        other = c if k == 0 else a
        trial = np.clip(free, low, high)
        trial[:, 1 - k] = np.clip(-(g[:, 1 - k] + b * trial[:, k]) / other, low[:, 1 - k], high[:, 1 - k])
        value = dot(g, trial) + b * trial[:, 0] * trial[:, 1]
        value += (own * trial[:, k] ** 2 + other * trial[:, 1 - k] ** 2) / 2
        take = crosses[rows, k] & (value < lowest)
        best[take], lowest[take] = trial[take], value[take]
    step[rows] = best
    return step
