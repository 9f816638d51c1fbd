"""Nearest neighbours within batches of small sets, on the CPU and on CUDA.

Tensors have their channels first, then the sets of a batch, then their members: so a layer on each member is one
matrix product, without copies.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

CHUNK = 1 << 24  # squared distances in memory at once: 64 MB


@torch.no_grad()
def nearest_others(x: Tensor, k: int) -> Tensor:
    """The k nearest other members of each member of a set, by Euclidean distance.

    A member is never its own neighbour. (The released code drops the first of k + 1 neighbours instead, which may be
    a copy of the point if points coincide.) The only neighbour in a set of one point is the point itself.

    Parameters
    ----------
    x : (c, b, n) tensor
        b sets of n members.
    k : int

    Returns
    -------
    (b, min(k, n - 1), n) int64 tensor
        In no particular order.
    """
    n = x.shape[2]
    if n == 1:
        return torch.zeros(x.shape[1], 1, 1, dtype=torch.int64, device=x.device)
    k = min(k, n - 1)
    found = []
    for part in x.split(max(1, CHUNK // n**2), dim=1):
        squared = squared_distances(part, part)
        squared.diagonal(dim1=1, dim2=2).fill_(torch.inf)
        found.append(_smallest(squared, k))
    return torch.cat(found).transpose(1, 2).contiguous()


@torch.no_grad()
def nearest(queries: Tensor, points: Tensor, k: int) -> Tensor:
    """The k points nearest each query.

    Parameters
    ----------
    queries : (c, b, m) tensor
    points : (c, b, n) tensor
    k : int

    Returns
    -------
    (b, min(k, n), m) int64 tensor
        In no particular order.
    """
    m, n = queries.shape[2], points.shape[2]
    k = min(k, n)
    step = max(1, CHUNK // (m * n))
    parts = zip(queries.split(step, dim=1), points.split(step, dim=1), strict=True)
    found = [_smallest(squared_distances(a, b), k) for a, b in parts]
    return torch.cat(found).transpose(1, 2).contiguous()


def squared_distances(a: Tensor, b: Tensor) -> Tensor:
    """|a|^2 - 2 a.b + |b|^2 of (c, b, m) and (c, b, n): (b, m, n). It rounds; near 0 it may be negative."""
    squared = torch.baddbmm((b * b).sum(0)[:, None, :], a.permute(1, 2, 0), b.transpose(0, 1), alpha=-2)
    return squared.add_((a * a).sum(0)[:, :, None])


def _smallest(squared: Tensor, k: int) -> Tensor:
    if k == squared.shape[2]:
        return torch.arange(k, device=squared.device).expand_as(squared)
    if squared.device.type == "cpu":  # twice as fast as topk
        return torch.from_numpy(np.argpartition(squared.numpy(), k - 1, axis=-1)[..., :k])
    return squared.topk(k, largest=False, sorted=False).indices


def gather(x: Tensor, index: Tensor) -> Tensor:
    """The members of sets (c, b, n) at an index (b, k, m): (c, b, k, m); the gradient flows back to them."""
    c, b, n = x.shape
    flat = index + torch.arange(0, b * n, n, device=x.device)[:, None, None]
    return x.reshape(c, -1).index_select(1, flat.reshape(-1)).reshape(c, *index.shape)
