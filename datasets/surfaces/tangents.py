"""Tangents at many normals at once, and scalar products of rows."""

from __future__ import annotations

import numpy as np


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n,) scalar products of the rows of two (n, 3) arrays."""
    return np.einsum("ni,ni->n", a, b)


def tangents(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two orthonormal tangents at each unit normal (n, 3): two (n, 3) arrays (Duff et al. 2017, without a pole)."""
    x, y, z = normals.T
    sign = np.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    return np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1), np.stack([b, sign + y * y * a, -y], axis=1)
