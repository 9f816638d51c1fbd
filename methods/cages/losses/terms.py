"""The terms of the loss of Neural Cages (Eq. 5.3 to 5.6)."""

from __future__ import annotations

import torch
from torch import Tensor

from .planes import EXACT, planes

MIRROR_X = (-1.0, 1.0, 1.0)


def chamfer(a: Tensor, b: Tensor) -> Tensor:
    """mean_a min_b |a - b|^2 + mean_b min_a |a - b|^2 of clouds (b, p, 3) and (b, q, 3), over the batch too."""
    with torch.no_grad():
        distances = torch.cdist(a, b, compute_mode=EXACT)
        there, back = distances.argmin(dim=2), distances.argmin(dim=1)
    return _squared(a, _taken(b, there)) + _squared(b, _taken(a, back))


def _taken(points: Tensor, index: Tensor) -> Tensor:
    return points.gather(1, index[..., None].expand(-1, -1, 3))


def _squared(a: Tensor, b: Tensor) -> Tensor:
    return (a - b).square().sum(dim=2).mean()


def negative_weights(weights: Tensor) -> Tensor:
    """Eq. 5.4: the mean square of the negative parts of the coordinates (b, p, n)."""
    return weights.clamp_max(0).square().mean()


def asymmetry(points: Tensor, mirror: tuple[float, float, float] = MIRROR_X) -> Tensor:
    """The Chamfer distance of points (b, p, 3) to their mirror image, which counts as constant."""
    return chamfer(points, points.detach() * points.new_tensor(mirror))


def plane_terms(before: Tensor, after: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
    """Eq. 5.5, the change of the distance of points to their neighbourhood's plane, and Eq. 5.6, that of its normal.

    The distance is that along a normal that counts as constant, as released; the sign of a normal is arbitrary, so
    angles are those between lines.

    Parameters
    ----------
    before, after : (b, p, 3) tensors
    index : (b, p, k) int tensor
        The neighbourhoods, from before.
    """
    with torch.no_grad():
        middle, normal = planes(before, index)
        distance = ((before - middle) * normal).sum(dim=2).abs()
    moved_middle, moved_normal = planes(after, index)
    moved = ((after - moved_middle) * moved_normal.detach()).sum(dim=2).abs()
    return (moved - distance).square().mean(), (1 - (normal * moved_normal).sum(dim=2).abs()).mean()


def laplacian_term(before: Tensor, after: Tensor, index: Tensor) -> Tensor:
    """The change of the uniform Laplacian's length, from the centroid of the neighbourhood, as in 3DN."""
    lengths = []
    for points in (before, after):
        batch = torch.arange(len(points), device=points.device)[:, None, None]
        lengths.append((points - points[batch, index].mean(dim=2)).norm(dim=2))
    return (lengths[0] - lengths[1]).square().mean()
