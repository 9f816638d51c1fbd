"""The protocol of the functions that define implicit surfaces."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    pass


class Field(Protocol):
    """A function of space, negative inside, with its gradient and a bound."""

    def value(self, points: np.ndarray) -> np.ndarray:
        """``f`` at points (n, 3): an (n,) array."""
        ...

    def gradient(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``f`` and its gradient at points (n, 3): (n,) and (n, 3) arrays."""
        ...

    def range(self, centres: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """A lower and an upper bound of ``f`` in the balls about ``centres`` (n, 3): two (n,) arrays."""
        ...
