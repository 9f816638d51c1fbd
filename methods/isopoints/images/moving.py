"""Points of a surface that move with the parameters of its field: their derivatives are those of intersections."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

FLAT = 1e-2  # the least divisor, a slope along a ray: a grazing ray would move a point far away
Motion = Literal["normal", "ray"]


def moving(
    values: Tensor, points: Tensor, gradients: Tensor, directions: Tensor, motion: Motion, most: float
) -> Tensor:
    """The points (n, 3) themselves, with derivatives by the parameters that ``values`` depend on.

    When parameters change, a point of the zero level moves along the gradient, ``x - g / |g|^2 (f - f_0)`` (Atzmon et
    al. 2019), or where its ray meets the level, ``x - d / (g . d) (f - f_0)`` (Yariv et al. 2020).

    Parameters
    ----------
    values : (n,) tensor
        The field at the points, with a graph to the parameters.
    gradients, directions : (n, 3) tensors
        Of the field there, and of the rays; taken as constant.
    motion : "normal" or "ray"
    most : float
        The largest norm of the derivative of a loss by a point; longer ones are shortened. 0: any.
    """
    if motion == "normal":
        away = gradients / gradients.square().sum(1, keepdim=True).clamp(min=FLAT)
    else:
        slope = (gradients * directions).sum(1, keepdim=True)
        away = directions / torch.where(slope.abs() < FLAT, torch.full_like(slope, -FLAT), slope)
    moved = points - away * (values - values.detach())[:, None]
    if most > 0 and moved.requires_grad:
        moved.register_hook(lambda slope: slope * (most / slope.norm(dim=1, keepdim=True).clamp(min=most)))
    return moved
