"""Even spacing: points move away from where their neighbours are dense (thesis, Eq. 4.7 to 4.9)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from .fields import Differentiable
from .neighbours import nearest
from .projection import Projection, project

NEWTON = 3  # steps back onto the zero level after each move (released)


@dataclass(frozen=True)
class Resampling:
    """The settings for spreading points.

    Lengths are those of a frame in which a shape has about the radius 1. ``D / |Q|``, D the diagonal of the points'
    box, is used as an area.
    """

    iterations: int = 5  # moves, each followed by a projection
    neighbours: int = 16  # thesis: 8
    bandwidth: float = 4.0  # sigma_p of Eq. 4.9 is this times D / |Q| (thesis: 16)
    # Eq. 4.7, with the unit directions of Eq. 4.8 averaged; or the released sum of offsets, weighted by the density
    rule: Literal["directions", "offsets"] = "directions"


def resample(
    field: Differentiable, at: Projection, how: Resampling = Resampling(), tolerance: float = 1e-5
) -> Projection:
    """Points on the zero level, moved along it to an even spacing.

    The text calls the direction a weighted average, and Eq. 4.8 is a weighted sum: with the sum, the spacing of points
    on a sphere hardly becomes more even (coefficient of variation 0.52 to 0.47 in ten moves), with the average it does
    (0.54 to 0.20). The average is used.
    """
    evaluations = 0
    for _ in range(how.iterations):
        at = project(field, _moved(at, how), tolerance=tolerance, steps=NEWTON)
        evaluations += at.evaluations
    return at._replace(evaluations=evaluations)


def _moved(at: Projection, how: Resampling) -> Tensor:
    points = at.points
    if len(points) < 2:
        return points
    near = nearest(points, how.neighbours)
    unit = area_unit(points)
    weights = torch.exp(-near.distances.square() / (how.bandwidth * unit))
    offsets = points[near.rows] - points[:, None]
    whole = weights.sum(1, keepdim=True).clamp(min=1e-12)
    if how.rule == "directions":
        directions = offsets / near.distances[..., None].clamp(min=1e-12)
        move = math.sqrt(unit) * (weights[..., None] * directions).sum(1) / whole
    else:
        normals = torch.nn.functional.normalize(at.gradients[near.rows], dim=2)
        tangential = offsets - (offsets * normals).sum(2, keepdim=True) * normals
        move = (1 + whole) * (weights[..., None] * tangential).sum(1) / whole
    return points - move


def area_unit(points: Tensor) -> float:
    """``D / |Q|``: the diagonal of the points' box divided by their number."""
    diagonal = torch.linalg.vector_norm(points.amax(0) - points.amin(0))
    return float(diagonal) / len(points)
