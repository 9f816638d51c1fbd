"""Shared by the tests of learned denoisers: surfaces known exactly, and training examples of them."""

from __future__ import annotations

import numpy as np


def ball(count: int = 3000) -> np.ndarray:
    """Evenly spread points of the unit sphere (Fibonacci): (count, 3)."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    return np.column_stack([np.cos(angle) * np.sqrt(1 - z**2), np.sin(angle) * np.sqrt(1 - z**2), z])


def square(count: int = 3000, seed: int = 0) -> np.ndarray:
    """Random points of the square [-1, 1]^2 at height 0: (count, 3)."""
    return np.random.default_rng(seed).uniform(-1, 1, (count, 3)) * [1, 1, 0]


def examples(counts: tuple[int, ...] = (200, 600), shapes: int = 3) -> dict[str, np.ndarray]:
    """Training examples of balls only."""
    clouds = [ball(count) for _ in range(shapes) for count in counts]
    return {
        "points": np.concatenate([np.round(cloud * 32767).astype(np.int16) for cloud in clouds]),
        "normals": np.concatenate([np.round(cloud * 127).astype(np.int8) for cloud in clouds]),
        "scales": np.full(shapes, 1 / 32767),
        "counts": np.array(counts),
    }
