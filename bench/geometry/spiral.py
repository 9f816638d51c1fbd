"""Directions that are evenly spread."""

from __future__ import annotations

import numpy as np


def golden_spiral(count: int) -> np.ndarray:
    """Unit vectors along a spiral from pole to pole, each the golden angle on from the one before: (count, 3)."""
    k = np.arange(count) + 0.5
    height, angle = 1 - 2 * k / count, k * np.pi * (3 - np.sqrt(5))
    around = np.sqrt(1 - height**2)
    return np.column_stack([around * np.cos(angle), around * np.sin(angle), height])
