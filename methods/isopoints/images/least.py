"""The least values on rays, found by the iso-points around them (thesis, figure 4.18 right)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from ..sampling.fields import values_at
from .scene import Rays

NEAREST = 16  # iso-points nearest to a ray: they belong to all layers that it passes through


def about(rays: Rays, points: Tensor, slack: float, samples: int) -> Tensor:
    """Distances (n, samples) along rays, from the first to the last of the iso-points (m, 3) nearest to each.

    If the surface does not reach the ray yet, that is near the part of it nearest to the ray. The interval is extended
    by ``slack`` at both ends.
    """
    along = rays.directions @ points.T - (rays.directions * rays.origins).sum(1, keepdim=True)
    # squared distances from the origins; subtracting the part along the rays leaves that across them
    whole = rays.origins.square().sum(1, keepdim=True) - 2 * rays.origins @ points.T + points.square().sum(1)
    closest = (whole - along.square()).topk(min(NEAREST, len(points)), dim=1, largest=False).indices
    near = along.gather(1, closest)
    first, last = near.amin(1, keepdim=True) - slack, near.amax(1, keepdim=True) + slack
    return first + torch.linspace(0, 1, samples, device=points.device) * (last - first)


class Least(NamedTuple):
    """The samples found on rays."""

    points: Tensor  # (n, 3)
    values: Tensor  # (n,)


@torch.no_grad()
def least(values: Callable[[Tensor], Tensor], rays: Rays, t: Tensor, first: bool = False) -> Least:
    """The samples of least value among distances (n, k) along rays, or (``first``) the first one inside.

    Parameters
    ----------
    values : function of points (n, 3) to values (n,), negative inside
    first : bool
        If a ray enters the surface, take its first sample with a value below 0 instead: samples that should be
        outside push the surface away from there.
    """
    if not len(t):
        return Least(t.new_zeros(0, 3), t.new_zeros(0))
    x = rays.origins[:, None] + t[..., None] * rays.directions[:, None]
    f = values_at(values, x.reshape(-1, 3)).reshape(t.shape)
    chosen = f.argmin(1)
    if first:
        inside = f < 0
        distance = torch.where(inside, t, torch.inf)
        chosen = torch.where(inside.any(1), distance.argmin(1), chosen)
    rows = torch.arange(len(x), device=x.device)
    return Least(x[rows, chosen], f[rows, chosen])
