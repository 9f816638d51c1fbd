"""Gradient noise in space (Perlin 2002) and its fractal sums, with derivatives."""

from __future__ import annotations

from itertools import product

import numpy as np

from .duals import Dual, Point
from .jets import Jet

BOUND = 0.75**0.5  # of the absolute value: the largest weighted mean distance to the corners of the unit cell


class GradientNoise:
    """Noise of one octave: 0 at all points with integer coordinates, with random slopes there.

    Parameters
    ----------
    rng : numpy Generator
        Shuffles the table that gives each lattice point one of 256 random unit slopes. The period is 256.
    """

    def __init__(self, rng: np.random.Generator):
        self._shuffled = rng.permutation(256)
        slopes = rng.normal(size=(256, 3))
        self._slopes = slopes / np.linalg.norm(slopes, axis=1, keepdims=True)
        self._columns = np.ascontiguousarray(self._slopes.T)
        self._twice = np.concatenate([self._shuffled, self._shuffled])  # avoids a modulo for sums of two of its entries

    def __call__(self, x: Jet) -> Jet:
        """The noise at points x, a vector function; twice continuously differentiable."""
        cell = np.floor(x.value).astype(np.int64)
        local = [x[k] - cell[k].astype(float) for k in range(3)]
        fades = [t * t * t * (t * (t * 6 - 15) + 10) for t in local]
        weights = [(1 - fade, fade) for fade in fades]
        total: Jet | None = None
        for i, j in product((0, 1), repeat=2):
            side = weights[0][i] * weights[1][j]
            for k in (0, 1):
                slope = self._slopes[self._hash(cell[0] + i, cell[1] + j, cell[2] + k)].T
                height = (local[0] - i) * slope[0] + (local[1] - j) * slope[1] + (local[2] - k) * slope[2]
                corner = side * weights[2][k] * height
                total = corner if total is None else total + corner
        assert total is not None
        return total

    def at(self, point: Point) -> Dual:
        """The noise at n points in space, with its gradient if the points have one; the same function, unrolled."""
        x = np.stack([p.v for p in point])
        cell = np.floor(x)
        local, cell = x - cell, cell.astype(np.int64) & 255
        fade = local * local * local * (local * (local * 6 - 15) + 10)
        take = self._twice.take
        rows_i = [take(cell[0] + i) + cell[1] for i in (0, 1)]
        rows_ij = [take(row + j) + cell[2] for row in rows_i for j in (0, 1)]
        corners = [take(row + k) for row in rows_ij for k in (0, 1)]  # i, j, k: k runs fastest
        slopes = [np.stack([column.take(corner) for column in self._columns]) for corner in corners]
        near, far = local, local - 1
        heights = []
        for corner, slope in enumerate(slopes):
            i, j, k = corner >> 2, corner >> 1 & 1, corner & 1
            height = (far if i else near)[0] * slope[0] + (far if j else near)[1] * slope[1]
            heights.append(height + (far if k else near)[2] * slope[2])
        along_z = [b - a for a, b in zip(heights[::2], heights[1::2], strict=True)]
        at_z = [a + fade[2] * d for a, d in zip(heights[::2], along_z, strict=True)]
        along_y = [b - a for a, b in zip(at_z[::2], at_z[1::2], strict=True)]
        at_y = [a + fade[1] * d for a, d in zip(at_z[::2], along_y, strict=True)]
        value = at_y[0] + fade[0] * (at_y[1] - at_y[0])
        if point[0].g is None:
            return Dual(value)
        turn = 30 * (local * (local - 1)) ** 2  # derivatives of the fades
        mean = slopes
        for axis in (2, 1, 0):
            mean = [a + fade[axis] * (b - a) for a, b in zip(mean[::2], mean[1::2], strict=True)]
        step_y = along_y[0] + fade[0] * (along_y[1] - along_y[0])
        step_z = [a + fade[1] * (b - a) for a, b in zip(along_z[::2], along_z[1::2], strict=True)]
        steps = (at_y[1] - at_y[0], step_y, step_z[0] + fade[0] * (step_z[1] - step_z[0]))
        return Dual(value, sum(p.g * (mean[0][k] + turn[k] * steps[k]) for k, p in enumerate(point)))

    def _hash(self, i: np.ndarray, j: np.ndarray, k: np.ndarray) -> np.ndarray:
        table = self._shuffled
        return table[(table[(table[i & 255] + j) & 255] + k) & 255]


class FractalNoise:
    """The sum of ``2^(-k hurst) noise_k(2^k frequency x)`` over k < octaves, divided by a bound: within -1..1."""

    def __init__(self, octaves: int, hurst: float, frequency: float, rng: np.random.Generator):
        self._layers = [GradientNoise(rng) for _ in range(octaves)]
        self._shifts = rng.uniform(0, 256, size=(octaves, 3, 1))
        self._weights = 2.0 ** (-hurst * np.arange(octaves))
        self._weights /= BOUND * self._weights.sum()
        self._frequencies = frequency * 2.0 ** np.arange(octaves)

    def __call__(self, x: Jet) -> Jet:
        """The sum at points x, a vector function."""
        layers = zip(self._layers, self._weights, self._frequencies, self._shifts, strict=True)
        total: Jet | float = 0.0
        for layer, weight, f, shift in layers:
            total = total + layer(x * f + shift) * weight
        assert isinstance(total, Jet)  # there is at least one octave
        return total
