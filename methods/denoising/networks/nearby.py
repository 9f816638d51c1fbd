"""Nearest neighbours within batches of small sets. Tensors have sets first, then members, then channels."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

TOGETHER = 1 << 24  # squared distances in memory at once: 64 MB


@torch.no_grad()
def nearest(queries: Tensor, points: Tensor, k: int) -> Tensor:
    """The k points nearest each query, in no particular order.

    Parameters
    ----------
    queries : (b, m, c) tensor
    points : (b, n, c) tensor
    k : int

    Returns
    -------
    (b, m, min(k, n)) int64 tensor
    """
    k, step = min(k, points.shape[1]), max(1, TOGETHER // (queries.shape[1] * points.shape[1]))
    parts = zip(queries.split(step), points.split(step), strict=True)
    return torch.cat([_smallest(squared_distances(a, b), k) for a, b in parts])


def squared_distances(a: Tensor, b: Tensor) -> Tensor:
    """|a|^2 - 2 a.b + |b|^2 of (b, m, c) and (b, n, c): (b, m, n). It rounds; near 0 it may be negative."""
    squared = torch.baddbmm((b * b).sum(2)[:, None, :], a, b.transpose(1, 2), alpha=-2)
    return squared.add_((a * a).sum(2)[:, :, None])


def _smallest(squared: Tensor, k: int) -> Tensor:
    if k == 1:
        return squared.argmin(dim=2, keepdim=True)
    if k == squared.shape[2]:
        return torch.arange(k, device=squared.device).expand_as(squared)
    if squared.device.type == "cpu":  # twice as fast as topk
        return torch.from_numpy(np.argpartition(squared.numpy(), k - 1, axis=-1)[..., :k])
    return squared.topk(k, largest=False, sorted=False).indices


def gather(x: Tensor, index: Tensor) -> Tensor:
    """The members of sets (b, n, c) at an index (b, m, k): (b, m, k, c); the gradient flows back to them."""
    b, n, c = x.shape
    flat = index + torch.arange(0, b * n, n, device=x.device)[:, None, None]
    return x.reshape(-1, c).index_select(0, flat.reshape(-1)).reshape(*index.shape, c)
