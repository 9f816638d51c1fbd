"""The loss of a level: squared distances in both directions between two sets, without those of outliers."""

from __future__ import annotations

import torch
from torch import Tensor

from ..networks.neighbours import CHUNK, gather, squared_distances

DELTA = 2.0  # mean squared distances, above which a distance counts as an outlier's
FIDELITY = 50.0


def chamfer(points: Tensor, truth: Tensor, outliers: bool = True) -> Tensor:
    """mean_p xi(d^2) + mean_q xi(d^2) of each patch (Wang et al. 2019, Eq. 3).

    xi omits distances of at least DELTA times the mean of its patch and direction; the mean still divides by the number
    of all.

    Parameters
    ----------
    points : (3, b, m) tensor
    truth : (3, b, n) tensor
    outliers : bool
        Whether outliers count like all others: xi is then the identity.

    Returns
    -------
    (b,) tensor
    """
    there, back = [], []
    with torch.no_grad():
        step = max(1, CHUNK // (points.shape[2] * truth.shape[2]))
        for a, b in zip(points.split(step, dim=1), truth.split(step, dim=1), strict=True):
            squared = squared_distances(a, b)
            there.append(squared.argmin(2))
            back.append(squared.argmin(1))
    return _one_way(points, truth, torch.cat(there), outliers) + _one_way(truth, points, torch.cat(back), outliers)


def _one_way(points: Tensor, others: Tensor, index: Tensor, outliers: bool) -> Tensor:
    squared = (points - gather(others, index[:, None])[:, :, 0]).square().sum(0)
    if not outliers:
        squared = squared * (squared < DELTA * squared.mean(1, keepdim=True)).detach()
    return squared.mean(1)
