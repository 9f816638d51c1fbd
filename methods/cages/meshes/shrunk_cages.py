"""Round cages shrunk towards a shape."""

from __future__ import annotations

import torch
from torch import Tensor

MARGIN = 1.1  # least factor by which a face is farther out than its outermost point
ASIDE = -1e-6  # a point on the border of two faces may be slightly outside of both


def shrunk_cage(directions: Tensor, faces: Tensor, points: Tensor, gap: float) -> Tensor:
    """Cages whose vertices move inward along their rays until a point is near, and that leave no point outside.

    A vertex stops where it first touches a ball of radius ``gap`` around a point, or around the origin, which also
    stops those that miss all points. If a face would then cut through the points, its corners move out again.
    The cages are star-shaped about the origin, so they do not intersect themselves.

    Parameters
    ----------
    directions : (n, 3) tensor
        Unit vectors: the vertices of a round cage about the origin.
    faces : (f, 3) int64 tensor
    points : (b, p, 3) tensor
    gap : float
        In the unit of the points.

    Returns
    -------
    cages : (b, n, 3) tensor
    """
    with torch.no_grad():
        along = points @ directions.T
        square = gap**2 - points.square().sum(dim=2, keepdim=True) + along.square()
        touching = torch.where(square >= 0, along + square.clamp_min(0).sqrt(), gap)
        radii = touching.amax(dim=1).clamp_min(gap)
        radii = radii * _missing(directions, faces, points, radii)
        return radii[..., None] * directions


def _missing(directions: Tensor, faces: Tensor, points: Tensor, radii: Tensor) -> Tensor:
    """The factors (b, n), at least 1, by which vertices at those radii must move out to enclose all points.

    A point is a combination of the directions of three corners, without negative weights for the face that its own ray
    meets; it is inside if the weights over the radii sum to less than 1.
    """
    solved = torch.linalg.inv(directions[faces])  # (f, 3, 3): a point times it is its weights
    weights = torch.einsum("bpa,fac->bfpc", points, solved)
    met = (weights >= ASIDE).all(dim=3)
    depth = (weights / radii[:, faces][:, :, None]).sum(dim=3)
    factor = torch.where(met, MARGIN * depth, 1.0).amax(dim=2).clamp_min(1.0)
    corners = faces.reshape(-1).expand(len(points), -1)
    return torch.ones_like(radii).scatter_reduce(1, corners, factor.repeat_interleave(3, dim=1), "amax")
