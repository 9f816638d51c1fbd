"""The least values on rays, found by the iso-points around them (thesis, figure 4.18 right)."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from .scene import Rays

NEAREST = 8  # iso-points nearest to a ray: they are of all layers that it passes through


def about(rays: Rays, points: Tensor, slack: float, samples: int) -> Tensor:
    """Distances (n, samples) along rays, from the first to the last of the iso-points (m, 3) nearest to each.

    Where the surface has not grown to a ray yet, that is beside the part of it that is nearest to the ray. The part is
    longer by ``slack`` at both ends.
    """
    along = rays.directions @ points.T - (rays.directions * rays.origins).sum(1, keepdim=True)
    # squared distances from the origins; those of the points across the rays are what is left of them
    whole = rays.origins.square().sum(1, keepdim=True) - 2 * rays.origins @ points.T + points.square().sum(1)
    closest = (whole - along.square()).topk(min(NEAREST, len(points)), dim=1, largest=False).indices
    near = along.gather(1, closest)
    first, last = near.amin(1, keepdim=True) - slack, near.amax(1, keepdim=True) + slack
    return first + torch.linspace(0, 1, samples, device=points.device) * (last - first)


@torch.no_grad()
def least(values: Callable[[Tensor], Tensor], rays: Rays, t: Tensor) -> Tensor:
    """Of places at distances (n, k) along rays those with the least value: (n, 3)."""
    x = rays.origins[:, None] + t[..., None] * rays.directions[:, None]
    if not len(x):
        return x[:, 0]
    f = torch.cat([values(part) for part in x.reshape(-1, 3).split(4096)]).reshape(t.shape)
    return x[torch.arange(len(x), device=x.device), f.argmin(1)]
