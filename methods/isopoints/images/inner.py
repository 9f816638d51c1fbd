"""Samples within a mask that should be inside the surface (thesis, figure 4.18 right)."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from .scene import Rays

NEAREST = 16  # iso-points nearest to a ray: they are of all layers that it passes through
SAMPLES = 32  # on the part of a ray between them (released: 64)


@torch.no_grad()
def inner_points(values: Callable[[Tensor], Tensor], rays: Rays, points: Tensor, slack: float) -> Tensor:
    """The places (n, 3) of the least values on rays, between the first and the last of the iso-points around each.

    Where the surface has not grown to a ray yet, that is beside the part of it that is nearest to the ray.

    Parameters
    ----------
    values : function of points (n, 3) to values (n,), negative inside
    rays : Rays
    points : (m, 3) tensor
        Iso-points.
    slack : float
        The part of the ray is longer by so much at both ends.
    """
    offsets = points - rays.origins[:, None]
    along = (offsets * rays.directions[:, None]).sum(2)
    across = offsets.square().sum(2) - along.square()
    near = along.gather(1, across.topk(min(NEAREST, len(points)), dim=1, largest=False).indices)
    first, last = near.amin(1) - slack, near.amax(1) + slack
    t = first[:, None] + torch.linspace(0, 1, SAMPLES, device=points.device) * (last - first)[:, None]
    return least(values, rays, t)


@torch.no_grad()
def least(values: Callable[[Tensor], Tensor], rays: Rays, t: Tensor) -> Tensor:
    """Of places at distances (n, k) along rays those with the least value: (n, 3)."""
    x = rays.origins[:, None] + t[..., None] * rays.directions[:, None]
    if t.shape[1] == 1:
        return x[:, 0]
    f = torch.cat([values(part) for part in x.reshape(-1, 3).split(4096)]).reshape(t.shape)
    return x[torch.arange(len(x), device=x.device), f.argmin(1)]
