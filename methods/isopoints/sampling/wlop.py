"""First points from a noisy cloud: weighted locally optimal projection (Huang et al. 2009)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .neighbours import nearest
from .resampling import area_unit

ROUNDS = 6
NEIGHBOURS = 60
REPULSION = 0.3  # mu: the weight of the repulsion between close points (released: 0.5, 0.65)
WIDE = (
    4.0  # squares of lengths over which points of the cloud are averaged, relative to the spacing of the moved points
)


def wlop(
    cloud: Tensor,
    count: int,
    *,
    rounds: int = ROUNDS,
    neighbours: int = NEIGHBOURS,
    repulsion: float = REPULSION,
) -> Tensor:
    """Up to ``count`` points where those of a cloud (n, 3), in any order, are densest, at a distance from each other.

    Each round moves a point to the median-like average of the cloud around it, with less weight for crowded points of
    the cloud, and away from the other moved points.
    """
    unit = area_unit(cloud)
    # a random part of the cloud: an evenly spaced one would consist of its outliers
    points = cloud[:: max(1, len(cloud) // count)][:count].clone()
    near = nearest(cloud, neighbours)
    crowd = 1 + _theta(near.distances, unit).sum(1)
    # much wider than the noise, otherwise points near a stray one stay there
    wide = WIDE * unit * max(1.0, len(cloud) / max(1, len(points)))
    for _ in range(rounds):
        data = nearest(points, neighbours, cloud)
        alpha = _theta(data.distances, wide) / data.distances.clamp(min=1e-9) / crowd[data.rows]
        attracted = _average(cloud[data.rows], alpha)
        if len(points) > 1:
            own = nearest(points, neighbours)
            theta = _theta(own.distances, wide)
            beta = theta / own.distances.clamp(min=1e-9) * (1 + theta.sum(1))[own.rows]
            attracted = attracted + repulsion * _average(points[:, None] - points[own.rows], beta)
        points = attracted
    return points


def _theta(distances: Tensor, unit: float) -> Tensor:
    """exp(-16 r^2 / h^2) with h = 4 sqrt(unit)."""
    return torch.exp(-(distances / math.sqrt(unit)).square())


def _average(vectors: Tensor, weights: Tensor) -> Tensor:
    whole = weights.sum(1, keepdim=True).clamp(min=1e-30)
    return (weights[..., None] * vectors).sum(1) / whole
