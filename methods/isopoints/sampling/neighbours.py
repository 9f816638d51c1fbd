"""Nearest points of a cloud."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor


class Neighbours(NamedTuple):
    """The nearest other points of each point, the nearest first."""

    rows: Tensor  # (n, k) int64
    distances: Tensor  # (n, k), in the type of the points


def nearest(points: Tensor, k: int, among: Tensor | None = None) -> Neighbours:
    """The k nearest points of each: other points of the same cloud, or points of ``among`` (m, 3).

    A tree on the processor, also for points on a GPU: a few thousand points take 10 ms there, and a matrix of all their
    distances would take more memory than the network. There are fewer than k if the cloud has fewer.
    """
    own = among is None
    cloud = points if own else among
    assert cloud is not None
    k = min(k, len(cloud) - own)
    found, rows = cKDTree(_array(cloud)).query(_array(points), k=np.arange(1, k + 1 + own))
    if own:  # a point itself is usually first, but not if others coincide with it
        rows, found = _without_itself(rows, found)
    device = points.device
    return Neighbours(torch.from_numpy(rows).to(device), torch.from_numpy(found).to(device, points.dtype))


def _without_itself(rows: np.ndarray, distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    others = rows != np.arange(len(rows))[:, None]
    others[others.all(axis=1), -1] = False
    shape = (len(rows), rows.shape[1] - 1)
    return rows[others].reshape(shape), distances[others].reshape(shape)


def _array(points: Tensor) -> np.ndarray:
    return points.detach().double().cpu().numpy()
