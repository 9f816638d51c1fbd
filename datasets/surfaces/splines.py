"""Profiles: plane curves as quintic B-splines, as jets of their parameter."""

from __future__ import annotations

from math import factorial

import numpy as np

from .jets import Jet


class Profile:
    """A curve (r, z) over t in 0..1 near its control points; four continuous derivatives.

    Parameters
    ----------
    controls : (n, 2) array
        At t = 0 the curve starts on the axis: the control points continue as their mirror image there, so that r is odd
        and z is even in t and the surface of revolution is smooth at its pole. ``controls[0]`` lies on the axis.
    """

    def __init__(self, controls: np.ndarray):
        from scipy.interpolate import BSpline

        controls = np.asarray(controls, dtype=np.float64)
        mirrored = controls[3:0:-1] * [-1, 1]
        end = 2 * controls[-1] - controls[-2:-5:-1]  # point-symmetric: the curve ends at the last control, straight
        full = np.concatenate([mirrored, controls, end])
        spans = len(controls) - 1
        # Knots so that t = 0 lies over the first control point and t = 1 over the last.
        knots = (np.arange(len(full) + 6) - 3 - 3) / spans
        self._spline = BSpline(knots, full, 5)

    def __call__(self, t: Jet) -> tuple[Jet, Jet]:
        """r and z at t."""
        values = [self._spline(t.value, k) / factorial(k) for k in range(t.order + 1)]
        return t.compose(*(x[:, 0] for x in values)), t.compose(*(x[:, 1] for x in values))

    def points(self, t: np.ndarray) -> np.ndarray:
        """(n, 2) points of the curve."""
        return self._spline(t)

    def smallest_radius(self) -> float:
        """The smallest radius of curvature, over 2000 points."""
        d, dd = (self._spline(np.linspace(0, 1, 2001), k) for k in (1, 2))
        bend = np.abs(d[:, 0] * dd[:, 1] - d[:, 1] * dd[:, 0])
        return float(((d**2).sum(axis=1) ** 1.5 / np.maximum(bend, 1e-300)).min())
