"""Squared distances from points to triangles and to segments, exact, and differentiable in the points.

The nearest triangle and the place on it are found without gradients: the derivative of the squared distance to the
nearest point, which moves along the surface, equals that of the squared distance to this point held fixed.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..networks.neighbours import CHUNK, gather

TINY = 1e-30


def squared_to_triangles(points: Tensor, corners: Tensor) -> Tensor:
    """The squared distance of each point to the nearest triangle of its set.

    Parameters
    ----------
    points : (3, b, n) tensor
    corners : (3, b, t, 3) tensor
        The corners of the triangles along the last axis; none has its corners on one line.

    Returns
    -------
    (b, n) tensor
    """
    with torch.no_grad():
        nearest = to_all_triangles(points, corners).argmin(1)
        of_one = torch.stack([gather(corners[..., k], nearest[:, None])[:, :, 0] for k in range(3)], dim=-1)
        closest = _on_triangle(points, of_one)
    return (points - closest).square().sum(0)


def squared_to_segments(points: Tensor, ends: Tensor) -> Tensor:
    """The squared distance of each point to the nearest segment of its set.

    Parameters
    ----------
    points : (3, b, n) tensor
    ends : (3, b, s, 2) tensor
        The ends of the segments along the last axis.

    Returns
    -------
    (b, n) tensor
    """
    with torch.no_grad():
        nearest = to_all_segments(points, ends).argmin(1)
        start, end = (gather(ends[..., k], nearest[:, None])[:, :, 0] for k in range(2))
        closest = _on_segment(points, start, end)
    return (points - closest).square().sum(0)


@torch.no_grad()
def to_all_triangles(points: Tensor, corners: Tensor) -> Tensor:
    """Squared distances (b, t, n) of points (3, b, n) to triangles (3, b, t, 3).

    In a frame of the triangle the distance is that to the plane, and, for points that project outside, that to the
    nearest edge within it. All of this are linear functions of the point: a product of matrices.
    """
    (_, b, t, _), n = corners.shape, points.shape[2]
    start = corners
    along = corners.roll(-1, dims=3) - corners
    length = along.square().sum(0).sqrt().clamp_min(TINY)
    along = along / length
    normal = _unit(torch.linalg.cross(along[..., 0], along[..., 1], dim=0))
    inward = torch.linalg.cross(normal[..., None].expand_as(along), along, dim=0)
    # (7 linear functions, 3 components, b, t): height, then place along and distance inward of each edge
    slopes = torch.stack([normal, *along.unbind(3), *inward.unbind(3)])
    origins = torch.stack([start[..., 0], *start.unbind(3), *start.unbind(3)])
    offsets = -(slopes * origins).sum(1)
    squared = []
    step = max(1, CHUNK // (7 * t * n))
    for low in range(0, b, step):
        part = slice(low, low + step)
        slope = slopes[:, :, part].permute(2, 0, 3, 1).reshape(-1, 7 * t, 3)
        offset = offsets[:, part].permute(1, 0, 2).reshape(-1, 7 * t, 1)
        values = torch.baddbmm(offset, slope, points[:, part].permute(1, 0, 2)).reshape(-1, 7, t, n)
        place, depth = values[:, 1:4], values[:, 4:]
        beyond = place - torch.minimum(place.clamp_min(0), _per(length, part))
        to_edge = (depth.square() + beyond.square()).amin(1)
        to_edge.masked_fill_((depth >= 0).all(1), 0.0)
        squared.append(values[:, 0].square() + to_edge)
    return torch.cat(squared)


@torch.no_grad()
def to_all_segments(points: Tensor, ends: Tensor) -> Tensor:
    """Squared distances (b, s, n) of points (3, b, n) to segments (3, b, s, 2)."""
    start, end = ends[..., None, 0], ends[..., None, 1]
    return (points[:, :, None] - _on_segment(points[:, :, None], start, end)).square().sum(0)


def _per(length: Tensor, part: slice) -> Tensor:
    """Lengths (b, t, 3) of some sets, as (b, 3, t, 1)."""
    return length[part].permute(0, 2, 1)[..., None]


def _unit(x: Tensor) -> Tensor:
    return x / x.square().sum(0).sqrt().clamp_min(TINY)


def _on_segment(points: Tensor, start: Tensor, end: Tensor) -> Tensor:
    """The point of each segment nearest each point; all (3, ...)."""
    along = end - start
    place = ((points - start) * along).sum(0) / along.square().sum(0).clamp_min(TINY)
    return start + place.clamp(0, 1) * along


def _on_triangle(points: Tensor, corners: Tensor) -> Tensor:
    """The point of each triangle (3, b, n, 3) nearest each point (3, b, n)."""
    a, b, c = corners.unbind(3)
    normal = _unit(torch.linalg.cross(b - a, c - a, dim=0))
    edges = ((a, b), (b, c), (c, a))
    inside = torch.stack(
        [(torch.linalg.cross(normal, end - start, dim=0) * (points - start)).sum(0) >= 0 for start, end in edges]
    ).all(0)
    candidates = torch.stack([_on_segment(points, start, end) for start, end in edges])
    which = (points - candidates).square().sum(1).argmin(0)
    on_edge = candidates.gather(0, which[None, None].expand(1, 3, *which.shape))[0]
    return torch.where(inside, points - ((points - a) * normal).sum(0) * normal, on_edge)
