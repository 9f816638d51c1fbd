"""Spherical products: one closed curve swept along another one, both superformulas.

With the longitude w and the latitude h, the surface is ``(a p(h) cos w r2(w), b p(h) sin w r2(w), c q(h))``, where
``p = major + r1(h) cos h`` and ``q = r1(h) sin h``. Superquadrics are the case m = 4, n1 = n2 = n3 = 2 / e.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import pi

import numpy as np

from .jets import Jet, abs_power, cos, sin, stack
from .parametric import Chart, Patch
from .patch_mesh import graded_lines, pole_levels

DENSE = 2001  # points on each piece of a curve, for grid lines and angles
EDGE_WINDOW = 0.02  # of the diagonal: the length of curve over which its turn is measured


def check_grid(rows: int, columns: int) -> None:
    """Raise ValueError, naming the parameter, for a tessellation that is too coarse or too fine."""
    for name, value in (("rows", rows), ("columns", columns)):
        if not 16 <= value <= 2048:
            raise ValueError(f"{name}: expected 16 to 2048, got {value}")


@dataclass(frozen=True)
class Superformula:
    """Gielis' ``r(t) = (|cos(m t / 4)|^n2 + |sin(m t / 4)|^n3)^(-1 / n1)``; it is smooth except at t = 2 pi k / m."""

    m: int  # number of lobes
    n1: float
    n2: float  # at least 1
    n3: float  # at least 1; equal to n2 where m is odd, otherwise the curve does not close

    def radius(self, t: Jet) -> Jet:
        """The radius at the angle t."""
        s = t * (self.m / 4)
        return (abs_power(cos(s), self.n2) + abs_power(sin(s), self.n3)) ** (-1 / self.n1)

    def curve(self, t: np.ndarray) -> np.ndarray:
        """(n, 2) points at the angles t."""
        r = self.radius(Jet.variables(t, t, 0)[0]).value
        return np.stack([r * np.cos(t), r * np.sin(t)], axis=1)

    def breaks(self, low: float, high: float) -> np.ndarray:
        """Angles in [low, high] at which the curve is cut: where it is not smooth, half-way between, and both ends."""
        step = pi / self.m
        inner = step * np.arange(np.ceil(low / step + 1e-9), np.floor(high / step - 1e-9) + 1)
        return np.concatenate([[low], inner, [high]])


@dataclass(frozen=True)
class SphericalProduct:
    """The surface of two superformulas."""

    latitude: Superformula  # r1, from pole to pole, or all around where there is a hole
    longitude: Superformula  # r2
    axes: tuple[float, float, float]  # a, b, c
    major: float = 0.0  # radius of the ring: 0 for none
    rows: int = 160  # approximate number of rows of cells
    columns: int = 256

    @property
    def _span(self) -> float:
        return pi if self.major else pi / 2

    def position(self, h: Jet, w: Jet) -> Jet:
        """The point at latitude h and longitude w."""
        a, b, c = self.axes
        r1, r2 = self.latitude.radius(h), self.longitude.radius(w)
        across = (r1 * cos(h) + self.major) * r2
        return stack(a * across * cos(w), b * across * sin(w), c * r1 * sin(h))

    def parts(self) -> tuple[list[Chart], list[Patch]]:
        """One chart, and a patch for each pair of pieces of the two curves."""
        meridian, ring = self._curves()
        h = _lines(self.latitude.breaks(-self._span, self._span), meridian, self.rows)
        w = _lines(self.longitude.breaks(-pi, pi), ring, self.columns)
        levels = None if self.major else _levels(np.concatenate([h[0], *(x[1:] for x in h[1:])]), meridian, w, ring)
        patches, row = [], 0
        for rows in h:
            part = None if levels is None else levels[row : row + len(rows)]
            patches += [Patch(0, rows, columns, part) for columns in w]
            row += len(rows) - 1
        return [Chart(self.position, flip=True)], patches

    def _curves(self):
        """Functions from angles to points of the meridian, at its mean width, and of the equator."""
        a, b, c = self.axes
        t = np.linspace(-pi, pi, 361)
        width = (np.linalg.norm(self.longitude.curve(t) * [a, b], axis=1)).mean()
        reach = np.abs(self.latitude.curve(np.linspace(-self._span, self._span, 361))[:, 0] + self.major).max()
        return (
            lambda t: (self.latitude.curve(t) + [self.major, 0]) * [width, c],
            lambda t: self.longitude.curve(t) * [a * reach, b * reach],
        )

    def extents(self) -> np.ndarray:
        """The lengths of the bounding box before rotation, (3,)."""
        meridian = self.latitude.curve(np.linspace(-self._span, self._span, DENSE)) + [self.major, 0]
        ring = self.longitude.curve(np.linspace(-pi, pi, DENSE))
        return np.array([*(np.ptp(ring, axis=0) * np.abs(meridian[:, 0]).max()), np.ptp(meridian[:, 1])]) * self.axes

    def sharpest_turn(self) -> float:
        """The largest turn of the normal in degrees within 2 % of the bounding-box diagonal, along both curves."""
        window = EDGE_WINDOW * float(np.linalg.norm(self.extents()))
        meridian, ring = self._curves()
        profile = meridian(np.linspace(-self._span, self._span, 2 * DENSE))
        if not self.major:  # continued over the pole to the other side: an apex is sharp as well
            mirrored = profile[::-1] * [-1, 1]
            profile = np.concatenate([profile, mirrored[1:]])
        return max(_turn(profile, window), _turn(ring(np.linspace(-pi, pi, 2 * DENSE)), window))


def _turn(closed: np.ndarray, window: float) -> float:
    """The largest change of direction, in degrees, along a closed curve within a length ``window``."""
    twice = np.concatenate([closed, closed[1:]])
    steps = np.diff(twice, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    steps, lengths = steps[lengths > 0], lengths[lengths > 0]
    along = np.cumsum(lengths) - lengths / 2
    angle = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    first = along < along[-1] - window
    return float(np.degrees(np.abs(np.interp(along[first] + window, along, angle) - angle[first]).max()))


def _lines(breaks: np.ndarray, curve, cells: int) -> list[np.ndarray]:
    """Grid lines between all neighbouring breaks, the same number in each, a multiple of 8."""
    each = max(8, 8 * round(cells / (len(breaks) - 1) / 8))
    dense = [np.linspace(low, high, DENSE) for low, high in pairwise(breaks)]
    return [graded_lines(curve(t), t, each) for t in dense]


def _levels(h: np.ndarray, meridian, w: list[np.ndarray], ring) -> np.ndarray:
    """How often to halve the columns of each row, towards the poles."""
    profile, columns = meridian(h), sum(len(lines) - 1 for lines in w)
    equator = ring(np.concatenate(w))
    widest = np.abs(profile[:, 0]).max()
    cell = np.linalg.norm(np.diff(equator, axis=0), axis=1).sum() / columns * np.abs(profile[:, 0]) / widest
    steps = np.linalg.norm(np.diff(profile, axis=0), axis=1)
    spacing = np.minimum(np.append(steps, steps[-1]), np.insert(steps, 0, steps[0]))
    return pole_levels(cell, spacing, len(w[0]) - 1)
