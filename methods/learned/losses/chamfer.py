"""The Chamfer distance to a fixed set of points, and its derivative."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor


class ChamferLoss:
    """mean_v min_p |v - p|^2 + mean_p min_v |p - v|^2 of points v and a target p.

    Parameters
    ----------
    target : (n, 3) array
        The first mean uses all of it.
    batch : int
        Points of the target used in the second mean, drawn once.
    rng : numpy Generator
    """

    def __init__(self, target: np.ndarray, batch: int, rng: np.random.Generator):
        self._target, self._tree = target, cKDTree(target)
        self._part = target if len(target) <= batch else target[rng.choice(len(target), batch, replace=False)]

    def __call__(self, points: Tensor) -> tuple[float, Tensor]:
        """The loss of points (v, 3), and its derivative with respect to them (v, 3)."""
        v = points.detach().cpu().numpy().astype(np.float64)
        distances, nearest = self._tree.query(v)
        back, owner = cKDTree(v).query(self._part)
        derivative = 2 / len(v) * (v - self._target[nearest])
        pulled = v[owner] - self._part
        for axis in range(3):
            derivative[:, axis] += 2 / len(self._part) * np.bincount(owner, pulled[:, axis], len(v))
        return float((distances**2).mean() + (back**2).mean()), torch.as_tensor(derivative).to(points)
