"""More points in sparse regions or at edges: the insertions of edge-aware resampling (thesis 4.2.1)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from .fields import Differentiable
from .neighbours import nearest
from .projection import Projection, project

NEIGHBOURS = 16
SHARE = 10  # at most a tenth of the points is inserted at once
PART = 2048  # points whose candidates are compared at once


class Candidates(NamedTuple):
    """The best new neighbour of each point."""

    priority: Tensor  # (n,), a distance; larger where points are sparse, or normals differ
    places: Tensor  # (n, 3)


def candidates(points: Tensor, normals: Tensor | None, edges: float = 0.0, neighbours: int = NEIGHBOURS) -> Candidates:
    """The priority of each point, ``P(p) = max_i B(p, p_i)``, and the position ``(2 p + p_i) / 3`` of the maximum.

    Without normals B is the distance from that place to the nearest point (of p's neighbours). With them it is that of
    Huang et al. 2013, ``B^2 = (2 - n . n_i)^edges min_j (|m - p_j|^2 - ((m - p_j) . n_j)^2)`` at the middle m: distance
    along the surface, and the larger the more normals differ. Insertion at the third, not in the middle, keeps the
    two ends of a pair from inserting the same point.

    Parameters
    ----------
    points, normals : (n, 3) tensors
        Unit normals, or None.
    edges : float
        The exponent: 0 for an even density.
    """
    near = nearest(points, neighbours)
    priorities, places = [], []
    for rows in torch.arange(len(points), device=points.device).split(PART):
        p, around = points[rows, None], points[near.rows[rows]]
        place = (2 * p + around) / 3
        m = place if normals is None else (p + around) / 2
        # from each candidate (axis 1) to each neighbour (axis 2), and to p itself
        others = torch.cat([around, p], dim=1)
        offsets = m[:, :, None] - others[:, None]
        squared = offsets.square().sum(3)
        if normals is not None:
            theirs = torch.cat([normals[near.rows[rows]], normals[rows, None]], dim=1)
            squared = squared - (offsets * theirs[:, None]).sum(3).square()
        least = squared.clamp(min=0).amin(2)
        if normals is not None and edges:
            alike = (normals[rows, None] * normals[near.rows[rows]]).sum(2)
            least = least * (2 - alike).clamp(min=0) ** edges
        best, which = least.max(1)
        priorities.append(best.sqrt())
        places.append(place[torch.arange(len(rows), device=rows.device), which])
    return Candidates(torch.cat(priorities), torch.cat(places))


def upsample(
    field: Differentiable,
    at: Projection,
    count: int,
    *,
    edges: float | None = None,
    neighbours: int = NEIGHBOURS,
    tolerance: float = 1e-5,
) -> Projection:
    """Insert points on the zero level until there are ``count``; the old ones stay, in their order, and come first.

    Parameters
    ----------
    at : Projection
        At least two points on the zero level.
    edges : float, optional
        Without it new points are set in sparse regions; with it the field's normals count: see :func:`candidates`.
    """
    result, evaluations = at, 0
    while len(result.points) < count:
        normals = None if edges is None else F.normalize(result.gradients, dim=1)
        found = candidates(result.points, normals, edges or 0.0, neighbours)
        some = min(count - len(result.points), max(1, len(result.points) // SHARE))
        best = torch.topk(found.priority, min(some, len(found.priority))).indices
        new = project(field, found.places[best], tolerance=tolerance)
        evaluations += new.evaluations
        points, gradients, values = (torch.cat(pair) for pair in zip(result[:3], new[:3], strict=True))
        result = Projection(points, gradients, values, 0)
    return result._replace(evaluations=evaluations)
