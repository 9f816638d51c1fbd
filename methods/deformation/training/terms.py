"""Terms of the losses, for sets of deformed points (b, n, 3) and their targets."""

from __future__ import annotations

import torch
from torch import Tensor

EXACT = "donot_use_mm_for_euclid_dist"  # the other mode has an error of 5e-4 in float32


@torch.no_grad()
def matches(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """The nearest of b (k, m, 3) for each point of a (k, n, 3), and the reverse: (k, n) and (k, m) indices."""
    sizes = a.square().sum(2), b.square().sum(2)
    to_b, to_a = [], []
    # Set by set, and again for each direction: one table of distances stays in the processor's cache.
    for one, other, own, others in zip(a, b, *sizes, strict=True):
        to_b.append(torch.addmm(others, one, other.t(), alpha=-2).argmin(1))
        to_a.append(torch.addmm(own, other, one.t(), alpha=-2).argmin(1))
    return torch.stack(to_b), torch.stack(to_a)


def taken(points: Tensor, index: Tensor) -> Tensor:
    """Members (k, m, 3) of points (k, n, 3) by their indices (k, m)."""
    return points.gather(1, index[:, :, None].expand(-1, -1, 3))


def chamfer(a: Tensor, b: Tensor) -> Tensor:
    """``mean_a min_b |a - b|^2 + mean_b min_a |a - b|^2``, the mean over the sets: a scalar."""
    to_b, to_a = matches(a, b)
    return squared(a, taken(b, to_b)) + squared(b, taken(a, to_a))


def squared(a: Tensor, b: Tensor) -> Tensor:
    """The mean of |a - b|^2 over corresponding points: a scalar."""
    return (a - b).square().sum(2).mean()


def distance(a: Tensor, b: Tensor) -> Tensor:
    """The mean of |a - b| over corresponding points: a scalar, whose derivative at 0 is 0."""
    return (a - b).square().sum(2).clamp_min(1e-12).sqrt().mean() - 1e-6


def earth_mover(a: Tensor, b: Tensor, rounds: int = 20) -> Tensor:
    """The approximate earth mover's distance, the least mean distance of a transport between both sets: a scalar.

    By Sinkhorn's iterations (Cuturi 2013) between uniform masses, with decreasing regularisation, down to a hundredth
    of the mean distance; the transport counts as constant in the derivative. About 0 for equal sets.

    Parameters
    ----------
    a, b : (k, n, 3) tensors
    rounds : int
    """
    lengths = torch.cdist(a, b, compute_mode=EXACT)
    with torch.no_grad():
        cost = lengths / lengths.mean((1, 2), keepdim=True).clamp_min(1e-12)
        u = v = cost.new_zeros(cost.shape[:2])
        for regular in torch.logspace(0, -2, rounds).tolist():
            # In units of the cost, so that potentials remain valid when the regularisation falls.
            u = -regular * ((v[:, None] - cost) / regular).logsumexp(2)
            v = -regular * ((u[:, :, None] - cost) / regular).logsumexp(1)
        transport = ((u[:, :, None] + v[:, None] - cost) / regular).exp()
    return (transport * lengths).sum(2).mean()


def laplacian_change(before: Tensor, after: Tensor, centers: int, neighbours: int) -> Tensor:
    """The mean squared change of ``p - mean of its neighbours``, the nearest ones before: a scalar.

    Parameters
    ----------
    before, after : (b, n, 3) tensors
        Corresponding points.
    centers : int
        The number of points used, the first ones.
    neighbours : int
        Of each.
    """
    with torch.no_grad():
        lengths = torch.cdist(before[:, :centers], before, compute_mode=EXACT)
        index = lengths.topk(neighbours + 1, dim=2, largest=False).indices[:, :, 1:]
    offset = after - before  # the operator is linear
    around = taken(offset, index.flatten(1)).reshape(*index.shape, 3).mean(2)
    return squared(offset[:, :centers], around)
