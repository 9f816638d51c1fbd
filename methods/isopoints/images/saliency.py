"""Salient points, which get more samples: those of high curvature, or high loss (thesis 4.2.1, figure 4.15)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..sampling.neighbours import nearest
from ..sampling.resampling import area_unit

NEIGHBOURS = 8
FEW = 50  # largest number of salient points, which are at most a twentieth of all


def curvatures(points: Tensor) -> Tensor:
    """The norm of the Laplacian (n,): the distance of points (n, 3) from the mean of their neighbours."""
    near = nearest(points, NEIGHBOURS)
    return (points - points[near.rows].mean(1)).norm(dim=1)


def averaged(loss: Tensor, point: Tensor, count: int) -> Tensor:
    """The mean loss of points (count,) from losses (m,) of views that see them; 0 for points that no view sees."""
    total = torch.zeros(count, device=loss.device).index_add_(0, point, loss)
    seen = torch.zeros(count, device=loss.device).index_add_(0, point, torch.ones_like(loss))
    return total / seen.clamp(min=1)


def salient(metric: Tensor) -> Tensor:
    """The rows of the points that count as salient, of a metric (n,).

    Those above ``min(2 median, max / 2)``; if these are none, or too many, the highest (released).
    """
    some = max(1, min(FEW, len(metric) // 20))
    rows = torch.nonzero(metric > torch.minimum(2 * metric.median(), 0.5 * metric.max()))[:, 0]
    return rows if 0 < len(rows) <= some else metric.topk(some).indices


def children(points: Tensor, metric: Tensor) -> Tensor:
    """New points (m, 3) about salient ones: ``2/3 p + 1/3 p_i`` for the neighbours p_i of all p within their reach.

    The reach is ``2 sqrt(D / |P|)`` (released: twice the radius of Eq. 4.8).
    """
    centers = points[salient(metric)]
    reach = 2 * math.sqrt(area_unit(points))
    fathers = torch.nonzero(nearest(points, 1, centers).distances[:, 0] < reach)[:, 0]
    near = nearest(points, NEIGHBOURS).rows[fathers]
    return ((2 * points[fathers, None] + points[near]) / 3).reshape(-1, 3)
