"""Midpoints between neighbours, moved down a learned distance to the surface."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from bench.geometry.farthest import farthest_points

from ..networks.distance_network import AROUND, DistanceNetwork, Local

GROWTH = 4  # largest factor by which a round increases the points
NEIGHBOURS = 8  # of a point, itself among them: He et al. take twice the ratio
TOGETHER = 1 << 14  # queries at once


class LearnedDistance:
    """The distance of a network to the surface of one cloud.

    Parameters
    ----------
    network : DistanceNetwork
    points : (m, 3) array, m >= 2
    device : str
    """

    def __init__(self, network: DistanceNetwork, points: np.ndarray, device: str):
        from scipy.spatial import cKDTree

        self.network, self.device, self._tree = network, device, cKDTree(points)
        index = self._nearest(points, network.neighbours + 1)
        with torch.no_grad():
            self._local: Local = network.encode(self._tensor(points), index)

    def distances(self, queries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances (n,) of queries (n, 3), negative on one side, and their gradients (n, 3)."""
        found = [self._part(part) for part in np.array_split(queries, -(-len(queries) // TOGETHER) or 1)]
        return np.concatenate([d for d, _ in found]), np.concatenate([g for _, g in found])

    def descend(self, points: np.ndarray, iterations: int, rate: float) -> np.ndarray:
        """Points (n, 3) after steps of ``rate`` times -d grad d: down half the square of the distance."""
        for _ in range(iterations if len(points) else 0):
            distance, gradient = self.distances(points)
            points = points - rate * distance[:, None] * gradient
        return points

    def _part(self, queries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = self._tensor(queries).requires_grad_()
        distance, _ = self.network(x, self._local, self._nearest(queries, AROUND))
        (gradient,) = torch.autograd.grad(distance.sum(), x)
        return distance.detach()[0].double().cpu().numpy(), gradient[:, 0].T.double().cpu().numpy()

    def _tensor(self, points: np.ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(points.T[:, None], dtype=np.float32)).to(self.device)

    def _nearest(self, queries: np.ndarray, k: int) -> Tensor:
        index = self._tree.query(queries, np.arange(1, min(k, self._tree.n) + 1))[1]
        return torch.from_numpy(np.ascontiguousarray(index.T[None], dtype=np.int64)).to(self.device)


def grow(points: np.ndarray, count: int, distance: LearnedDistance, iterations: int, rate: float) -> np.ndarray:
    """Points (m, 3), followed by new ones, in rounds: (count, 3) float64 array."""
    m = len(points)
    rounds = int(np.ceil(np.log(count / m) / np.log(GROWTH) - 1e-9))
    growth = (count / m) ** (1 / max(rounds, 1))
    for done in range(1, rounds + 1):
        target = count if done == rounds else round(m * growth**done)
        pool = np.concatenate([points, distance.descend(midpoints(points), iterations, rate)])
        if len(pool) < target:  # tiny clouds have few pairs; copies of points fill up
            pool = np.resize(pool, (target, 3))
        points = pool[farthest_points(pool, target, taken=len(points))]
    return points


def midpoints(points: np.ndarray) -> np.ndarray:
    """The midpoints (n, 3) between points (m, 3) and their nearest neighbours, each pair once."""
    from scipy.spatial import cKDTree

    k = min(NEIGHBOURS, len(points))
    index = cKDTree(points).query(points, np.arange(1, k + 1))[1]
    links = np.sort(np.stack([np.repeat(np.arange(len(points)), k), index.ravel()], axis=1), axis=1)
    links = np.unique(links[links[:, 0] < links[:, 1]], axis=0)
    return points[links].mean(axis=1)
