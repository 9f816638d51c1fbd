"""Losses that keep points apart."""

from __future__ import annotations

import torch
from torch import Tensor

from ..networks.grouping import ball_query
from ..networks.neighbours import gather

NEAREST = 4


def neighbour_distances(points: Tensor, radius: float, samples: int) -> Tensor:
    """Squared distances to the four nearest others of the first ``samples`` points in a ball, as released.

    A point with fewer others in its ball uses the first of them repeatedly, or itself.

    Parameters
    ----------
    points : (3, b, n) tensor
    radius : float
    samples : int

    Returns
    -------
    (b, 4, n) tensor
        Differentiable.
    """
    index = ball_query(points, points, radius, samples, trim=False)
    squared = (gather(points, index) - points[:, :, None]).square().sum(0)
    return squared.topk(NEAREST + 1, dim=1, largest=False).values[:, 1:]


def repulsion(points: Tensor, radius: float, width: float, samples: int = 20) -> Tensor:
    """mean(radius - d exp(-d^2 / width^2)) over the four nearest others of each point (Yu et al. 2018, Eq. 2).

    Parameters
    ----------
    points : (3, b, n) tensor
    radius, width : float
        0.07 and 0.03 in the released code, for 4,096 points in a patch of radius 1.
    samples : int
        Points of a ball that are used.
    """
    squared = neighbour_distances(points, radius, samples).clamp_min(1e-12)
    return (radius - squared.sqrt() * torch.exp(-squared / width**2)).mean()


def hinge_repulsion(points: Tensor, radius: float, least: float, samples: int = 15) -> Tensor:
    """mean(max(0, least - d^2)) over the four nearest others of each point (Yu et al. 2018b, Eq. 4).

    Parameters
    ----------
    points : (3, b, n) tensor
    radius, least : float
        0.07 and 0.001 in the released code, for 4,096 points in a patch of radius 1.
    samples : int
        Points of a ball that are used.
    """
    return (least - neighbour_distances(points, radius, samples)).clamp_min(0).mean()
