"""The descent of the released code: Nesterov momentum, clipped gradients, a rate that halves on a plateau."""

from __future__ import annotations

import numpy as np


class Descent:
    """Steps of one array of parameters.

    Parameters
    ----------
    rate : float
    largest : float
        Gradients are clipped at this, entry by entry.
    momentum : float
    patience : int
        The rate is halved when the loss has not fallen by a ten-thousandth for more steps than this; 0 for never.
    """

    FALLS, HALF = 1e-4, 0.5

    def __init__(self, rate: float, largest: float, momentum: float, patience: int):
        self.rate, self._largest, self._momentum, self._patience = rate, largest, momentum, patience
        self._velocity: np.ndarray | None = None
        self._best, self._waited = np.inf, 0

    def step(self, values: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """The values after a step."""
        gradient = np.clip(gradient, -self._largest, self._largest)
        before = self._velocity
        self._velocity = gradient if before is None else self._momentum * before + gradient
        return values - self.rate * (gradient + self._momentum * self._velocity)

    def begin(self) -> None:
        """Start with other images: losses are not comparable with those before. The rate stays."""
        self._best, self._waited = np.inf, 0

    def look(self, loss: float) -> None:
        """Receive the loss of a step."""
        if loss < self._best * (1 - self.FALLS):
            self._best, self._waited = loss, 0
            return
        self._waited += 1
        if self._patience and self._waited > self._patience:
            self.rate, self._waited = self.rate * self.HALF, 0


def unit(normals: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Normals (n, 3) at unit length; those that vanished are replaced by the previous ones."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 1e-9, normals / np.maximum(length, 1e-9), before)
