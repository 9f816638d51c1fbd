"""Colours of points: shading of their normals under lights, and other attributes to draw."""

from __future__ import annotations

import torch
from torch import Tensor


def diffuse(
    normals: Tensor, directions: Tensor, colors: Tensor, ambient: Tensor | float = 0.0, albedo: Tensor | float = 1.0
) -> Tensor:
    """Lambertian shading by infinitely far lights: albedo (ambient + sum over lights of max(n.l, 0) colour).

    Parameters
    ----------
    normals : (n, 3) tensor of unit length
    directions : (k, 3) tensor of unit length
        Towards the lights.
    colors : (k, 3) tensor
    ambient : (3,) tensor or float
    albedo : (n, 3) or (3,) tensor, or float

    Returns
    -------
    (n, 3) tensor
    """
    return albedo * (ambient + (normals @ directions.T).clamp_min(0) @ colors)


def of_normals(normals: Tensor) -> Tensor:
    """Normals as colours: (n + 1) / 2."""
    return 0.5 * (normals + 1)


def of_depths(points: Tensor, center: Tensor, forward: Tensor) -> Tensor:
    """Inverse depths (n, 1), from 0 for the farthest point to 1 for the nearest."""
    inverse = 1 / ((points - center) @ forward)
    low, high = inverse.min(), inverse.max()
    return ((inverse - low) / (high - low).clamp_min(torch.finfo(inverse.dtype).tiny))[:, None]
