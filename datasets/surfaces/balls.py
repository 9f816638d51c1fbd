"""Metaballs: sums of compact polynomial kernels, for blobs of a few balls and for branches of thousands."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

ROWS = 192  # points at a time, neighbours in space: only the balls near them are evaluated


class BallField:
    """``f(x) = 1 - sum over i of w_i (1 - |x - c_i|^2 / R_i^2)^3``, each term only within its reach R_i.

    Twice continuously differentiable; negative where the balls add up to more than 1.

    Parameters
    ----------
    centres : (m, 3) array
    reach : (m,) array
    weights : (m,) array, positive
    """

    def __init__(self, centres: np.ndarray, reach: np.ndarray, weights: np.ndarray):
        self.centres, self.reach, self.weights = (np.asarray(a, dtype=np.float64) for a in (centres, reach, weights))

    def value(self, points: np.ndarray) -> np.ndarray:
        """``f`` at points (n, 3): an (n,) array."""
        value = np.empty(len(points))
        for part, near in self._parts(points, 0.0):
            _, falloff = self._terms(points[part], near)
            value[part] = 1 - (self.weights[near] * falloff**3).sum(axis=1)
        return value

    def gradient(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``f`` and its gradient at points (n, 3): (n,) and (n, 3) arrays."""
        value, gradient = np.empty(len(points)), np.empty((len(points), 3))
        for part, near in self._parts(points, 0.0):
            offsets, falloff = self._terms(points[part], near)
            square = self.weights[near] * falloff**2
            value[part] = 1 - (square * falloff).sum(axis=1)
            square *= 6 / self.reach[near] ** 2
            for axis, offset in enumerate(offsets):
                gradient[part, axis] = (square * offset).sum(axis=1)
        return value, gradient

    def range(self, centres: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """A lower and an upper bound of ``f`` in the balls about ``centres`` (n, 3): two (n,) arrays.

        Each term falls with the distance, which changes by at most ``radius``.
        """
        low, high = np.empty((2, len(centres)))
        for part, near in self._parts(centres, radius):
            offsets = self._offsets(centres[part], near)
            distance = np.sqrt(offsets[0] ** 2 + offsets[1] ** 2 + offsets[2] ** 2)
            for result, moved in ((low, np.maximum(distance - radius, 0)), (high, distance + radius)):
                falloff = np.maximum(1 - (moved / self.reach[near]) ** 2, 0)
                result[part] = 1 - (self.weights[near] * falloff**3).sum(axis=1)
        return low, high

    def _parts(self, points: np.ndarray, margin: float) -> Iterator[tuple[slice, np.ndarray]]:
        """Rows of points, and the balls (indices) that reach within ``margin`` of any of them."""
        for start in range(0, len(points), ROWS):
            part = slice(start, start + ROWS)
            low, high = points[part].min(axis=0), points[part].max(axis=0)
            away = np.maximum(np.maximum(low - self.centres, self.centres - high), 0)
            yield part, np.flatnonzero((away**2).sum(axis=1) < (self.reach + margin) ** 2)

    def _offsets(self, points: np.ndarray, near: np.ndarray) -> list[np.ndarray]:
        return [points[:, axis, None] - self.centres[near, axis] for axis in range(3)]

    def _terms(self, points: np.ndarray, near: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """x - c_i by axes, each (n, m), and ``1 - |x - c_i|^2 / R_i^2``, zero beyond the reach: (n, m)."""
        offsets = self._offsets(points, near)
        square = offsets[0] ** 2 + offsets[1] ** 2 + offsets[2] ** 2
        return offsets, np.maximum(1 - square / self.reach[near] ** 2, 0)

    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """The corners of a box that holds all balls."""
        return (self.centres - self.reach[:, None]).min(axis=0), (self.centres + self.reach[:, None]).max(axis=0)
