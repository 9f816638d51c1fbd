"""Adam (Kingma and Ba 2015) for arrays of numpy."""

from __future__ import annotations

import numpy as np


class Adam:
    """Steps of one array of free numbers.

    Parameters
    ----------
    shape : tuple of int
    betas, epsilon
        As for Gaussian splatting: a negligible epsilon, so that steps do not depend on the scale of the loss.
    """

    def __init__(self, shape: tuple[int, ...], betas: tuple[float, float] = (0.9, 0.999), epsilon: float = 1e-15):
        self._mean, self._square = np.zeros(shape), np.zeros(shape)
        self._betas, self._epsilon, self._steps = betas, epsilon, 0

    def step(self, gradient: np.ndarray, rate: float) -> np.ndarray:
        """The increment of the numbers."""
        first, second = self._betas
        self._steps += 1
        self._mean += (1 - first) * (gradient - self._mean)
        self._square += (1 - second) * (gradient**2 - self._square)
        mean, square = self._mean / (1 - first**self._steps), self._square / (1 - second**self._steps)
        return -rate * mean / (np.sqrt(square) + self._epsilon)

    def forget(self, rows: np.ndarray) -> None:
        """Reset the moments of some rows."""
        self._mean[rows], self._square[rows] = 0, 0
