"""Fewer points, evenly spaced: crowded ones are removed."""

from __future__ import annotations

import torch
from torch import Tensor

from .neighbours import nearest

SHARE = 8  # at most an eighth of the points is removed at once


def thinned(points: Tensor, count: int) -> Tensor:
    """The rows (count,) of points (n, 3) that remain, in order, after repeated removal of those nearest to another one.

    Of two points that are mutually nearest, one stays in that round, so that no region is emptied.
    """
    rows = torch.arange(len(points), device=points.device)
    while len(rows) > count:
        near = nearest(points[rows], 1)
        partner, distance = near.rows[:, 0], near.distances[:, 0]
        own = torch.arange(len(rows), device=rows.device)
        stays = (partner[partner] == own) & (own < partner)
        distance = torch.where(stays, torch.inf, distance)
        some = min(len(rows) - count, max(1, len(rows) // SHARE))
        gone = torch.topk(distance, some, largest=False).indices
        keep = torch.ones(len(rows), dtype=torch.bool, device=rows.device)
        keep[gone] = False
        rows = rows[keep]
    return rows
