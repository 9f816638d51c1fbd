"""Features of the level before, interpolated by bilateral weights."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

EPSILON = 1e-12  # keeps weights finite if all queries coincide with points of the reference
NEIGHBOURS = 5


class Nearby(NamedTuple):
    """The nearest points of the level before of each point of a patch."""

    squared: Tensor
    """(b, k, n) tensor: squared distances, in any common unit of the patch"""
    features: Tensor
    """(c, b, k, n) tensor"""


def interpolate(features: Tensor, nearby: Nearby) -> Tensor:
    """Means of the nearby features, weighted by closeness in space and in features (Wang et al. 2019, Eq. 2).

    w = exp(-d^2 / (h/2)) for each of the two distances d, h the mean over the patch of the least d^2 of each point;
    f~_i = sum_j w_ij f_j / sum_j (w_ij + 1e-5). Weights are constants: gradients flow only to the nearby features.

    Parameters
    ----------
    features : (c, b, n) tensor
        Of the points themselves.
    nearby : Nearby

    Returns
    -------
    (c, b, n) tensor, finite even if points coincide
    """
    with torch.no_grad():
        between = (nearby.features - features[:, :, None]).square().sum(0)
        weight = _closeness(nearby.squared) * _closeness(between)
        weight = weight / (weight + 1e-5).sum(1, keepdim=True)
    return (nearby.features * weight).sum(2)


def _closeness(squared: Tensor) -> Tensor:
    bandwidth = squared.amin(1).mean(1)[:, None, None]
    return torch.exp(-squared / (bandwidth / 2 + EPSILON))
