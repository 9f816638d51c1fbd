"""Farthest points, balls of neighbours and interpolation within batches of sets, as in PointNet++ (Qi et al. 2017).

Tensors have their channels first, then the sets of a batch, then their members.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .neighbours import CHUNK, gather, nearest

FLOOR = 1e-10  # of squared distances, before they are inverted


@torch.no_grad()
def farthest_order(points: Tensor) -> Tensor:
    """The members of each set in greedy order, each the farthest from the ones before it.

    The first m of the order are the farthest point sample of m points, for every m, and the same order results from
    these m points alone. So one order serves all levels of a network.

    Parameters
    ----------
    points : (3, b, n) tensor
        The first member of each set comes first.

    Returns
    -------
    (b, n) int64 tensor
        A permutation of each set, even if points coincide.
    """
    _, b, n = points.shape
    order = torch.zeros(b, n, dtype=torch.int64, device=points.device)
    distance = torch.full((b, n), torch.inf, device=points.device, dtype=points.dtype)
    # A constant shape for every step: on CUDA nothing waits for the CPU.
    last = order[:, :1]
    for step in range(n):
        order[:, step : step + 1] = last
        distance.scatter_(1, last, -1.0)
        if step == n - 1:
            break
        chosen = points.gather(2, last.expand(3, b, 1))
        torch.minimum(distance, (points - chosen).square_().sum(0), out=distance)
        last = distance.argmax(1, keepdim=True)
    return order


@torch.no_grad()
def ball_query(queries: Tensor, points: Tensor, radius: float, count: int, trim: bool = True) -> Tensor:
    """The first ``count`` points, in the order of their indices, that are nearer to a query than ``radius``.

    Parameters
    ----------
    queries : (3, b, m) tensor
    points : (3, b, n) tensor
    radius : float
    count : int
    trim : bool
        Leave out copies that no query of the batch needs: they do not change a maximum over the neighbours.

    Returns
    -------
    (b, k, m) int64 tensor
        A query with fewer points repeats its first one; one without any has point 0, as in the released
        code. k is ``count``, or with ``trim`` the largest number in a ball of the batch, if that is less.
    """
    m, n = queries.shape[2], points.shape[2]
    found = []
    for a, p in zip(*(x.split(max(1, CHUNK // (m * n)), dim=1) for x in (queries, points)), strict=True):
        squared = (a[0][:, :, None] - p[0][:, None]).square_()
        for axis in (1, 2):
            squared += (a[axis][:, :, None] - p[axis][:, None]).square_()
        inside = squared < radius * radius
        rank = inside.cumsum(2, dtype=torch.int32)
        k = int(rank[:, :, -1].max().clamp(1, count)) if trim else count
        first = inside.to(torch.uint8).argmax(2)  # 0 if there is none
        index = first[:, None].repeat(1, k, 1)
        of_set, of_query, of_point = (inside & (rank <= k)).nonzero(as_tuple=True)
        index[of_set, rank[of_set, of_query, of_point].long() - 1, of_query] = of_point
        found.append(index)
    k = max(index.shape[1] for index in found)
    return torch.cat([torch.cat([i, i[:, :1].expand(-1, k - i.shape[1], -1)], 1) for i in found])


def interpolate(queries: Tensor, points: Tensor, features: Tensor) -> Tensor:
    """Features at queries: the mean of those of the three nearest points, weighted by 1 / squared distance.

    Parameters
    ----------
    queries : (3, b, n) tensor
    points : (3, b, m) tensor
    features : (c, b, m) tensor

    Returns
    -------
    (c, b, n) tensor
        Differentiable in the features; the weights are constants.
    """
    with torch.no_grad():
        index = nearest(queries, points, 3)
        weight = 1 / (gather(points, index) - queries[:, :, None]).square().sum(0).clamp_min(FLOOR)
        weight = weight / weight.sum(1, keepdim=True)
    return (gather(features, index) * weight).sum(2)
