"""Carved detail that follows a direction: locks and strands of hair, snail curls, folds of cloth, chisel marks.

Isotropic noise is stretched along a direction field by evaluating it in coordinates that change slowly along the
field's lines and fast across them.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..surfaces.duals import Dual, Point, atan2, cos, dot, ease, length, shifted, sin, soft_abs, taken
from ..surfaces.gradient_noise import GradientNoise


class Carver:
    """Noises for one sculpture.

    Parameters
    ----------
    rng : numpy Generator
        Draws the noise and its shifts.
    """

    def __init__(self, rng: np.random.Generator):
        self._noise = GradientNoise(rng)
        self._shifts = rng.uniform(0, 256, size=(64, 3))

    def noise(self, at: Point, layer: int) -> Dual:
        """Gradient noise in -0.87..0.87; a layer is the same noise with another shift."""
        return self._noise.at(shifted(at, self._shifts[layer].tolist()))

    def locks(self, a: Dual, b: Dual, along: Dual, layer: int, levels: int, *, crease: float = 0.06) -> Dual:
        """Round strands with creases between them, each split into finer ones, about 0..1.

        ``a`` and ``b`` change by 1 across a strand of the first level, ``along`` by 1 along it.
        """
        total: Dual | None = None
        size = 1.0
        for level in range(levels):
            f = 2.2**level
            bundle = soft_abs(self.noise((a * f, b * f, along * (f**0.35)), layer + level), crease)
            bundle = bundle * (1.6 * size)
            total = bundle if total is None else total + bundle
            size *= 0.34
        assert total is not None
        return total

    def folds(self, across: Dual, along: Dual, layer: int) -> Dual:
        """Folds of cloth: broad ridges with narrow valleys that start, fork and end, about 0..1."""
        wide = soft_abs(self.noise((across, along * 0.22, along * 0.1), layer), 0.05)
        fine = soft_abs(self.noise((across * 2.3, along * 0.45, across * 0.2), layer + 1), 0.06)
        return wide * 1.3 + fine * 0.45


class Curls:
    """Snail curls over the unit sphere: domes, each with a spiral groove."""

    def __init__(self, number: int, rng: np.random.Generator):
        k = np.arange(number) + 0.5
        z = 1 - 2 * k / number
        angle = np.pi * (1 + 5**0.5) * k
        centres = np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=1)
        self.spacing = float(np.sqrt(4 * np.pi / number))
        centres += 0.13 * self.spacing * rng.normal(size=(number, 3))
        self.centres = centres / np.linalg.norm(centres, axis=1, keepdims=True)
        side = np.cross(self.centres, rng.normal(size=(number, 3)))
        self._one = side / np.linalg.norm(side, axis=1, keepdims=True)
        self._other = np.cross(self.centres, self._one) * rng.choice([-1.0, 1.0], size=(number, 1))
        self._height = rng.uniform(0.75, 1.1, size=number)

    @cached_property
    def _tree(self):
        from scipy.spatial import cKDTree

        return cKDTree(self.centres)

    def height(self, direction: Point) -> Dual:
        """The relief at unit vectors, about 0..1.3."""
        reach = 0.92 * self.spacing
        places = np.stack([d.v for d in direction], axis=1)
        distances, nearest = self._tree.query(places, k=8)
        total = direction[0] * 0.0
        for k in range(8):
            rows = np.flatnonzero(distances[:, k] < reach)
            if len(rows):
                total = _added(total, rows, self._curl(taken(direction, rows), nearest[rows, k], reach))
        return total

    def _curl(self, d: Point, which: np.ndarray, reach: float) -> Dual:
        x, y, z = (p - c for p, c in zip(d, self.centres[which].T, strict=True))
        u, v = dot((x, y, z), self._one[which].T), dot((x, y, z), self._other[which].T)
        r = length(x, y, z)
        dome = ease(1 - r * (1 / reach)) * self._height[which]
        turns = cos(atan2(v, u) + r * (2 * np.pi / (0.5 * self.spacing)))
        middle = (r * (1 / (0.1 * self.spacing))).square()
        return dome * (1 + turns * (middle / (1 + middle)) * 0.24)


def _added(total: Dual, rows: np.ndarray, part: Dual) -> Dual:
    value = total.v.copy()
    value[rows] += part.v
    if total.g is None:
        return Dual(value)
    gradient = np.zeros((3, len(value))) + total.g
    gradient[:, rows] += part.g
    return Dual(value, gradient)


def about_axis(direction: Point, axes: np.ndarray, wave: float, turns: float, swirl: float) -> tuple[Dual, Dual, Dual]:
    """Coordinates of strands that leave an axis: (cosine, sine) of the angle about it, and the distance from it.

    Parameters
    ----------
    direction : unit vectors
    axes : (3, 3) array, its last row the axis
    wave, turns : float
        How far strands swing to the sides, in radians, and how often along their length.
    swirl : float
        Their total rotation about the axis.
    """
    h1, h2, up = (dot(direction, row) for row in axes.tolist())
    way = length(h1, h2, up - 1)
    rho = length(h1, h2) + 1e-9
    angle = sin(way * (2 * np.pi * turns)) * wave + way * swirl
    c, s = cos(angle), sin(angle)
    e1, e2 = h1 / rho, h2 / rho
    return e1 * c - e2 * s, e1 * s + e2 * c, way
