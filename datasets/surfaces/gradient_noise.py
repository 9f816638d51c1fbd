"""Gradient noise in space (Perlin 2002) and its fractal sums, with derivatives."""

from __future__ import annotations

from itertools import product

import numpy as np

from .jets import Jet

BOUND = 0.75**0.5  # of the absolute value: the mean distance of a corner of the unit cell, by its weights, at most


class GradientNoise:
    """Noise of one octave: 0 at all points with whole coordinates, with random slopes there.

    Parameters
    ----------
    rng : numpy Generator
        Shuffles the table that gives each lattice point one of 256 random unit slopes. The period is 256.
    """

    def __init__(self, rng: np.random.Generator):
        self._shuffled = rng.permutation(256)
        slopes = rng.normal(size=(256, 3))
        self._slopes = slopes / np.linalg.norm(slopes, axis=1, keepdims=True)

    def __call__(self, x: Jet) -> Jet:
        """The noise at points x, a vector function; twice continuously differentiable."""
        cell = np.floor(x.value).astype(np.int64)
        local = [x[k] - cell[k].astype(float) for k in range(3)]
        fades = [t * t * t * (t * (t * 6 - 15) + 10) for t in local]
        weights = [(1 - fade, fade) for fade in fades]
        total = None
        for i, j in product((0, 1), repeat=2):
            side = weights[0][i] * weights[1][j]
            for k in (0, 1):
                slope = self._slopes[self._hash(cell[0] + i, cell[1] + j, cell[2] + k)].T
                height = (local[0] - i) * slope[0] + (local[1] - j) * slope[1] + (local[2] - k) * slope[2]
                corner = side * weights[2][k] * height
                total = corner if total is None else total + corner
        return total

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
        return sum((layer(x * f + shift) * weight for layer, weight, f, shift in layers), start=0.0)
