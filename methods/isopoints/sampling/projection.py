"""Newton's method onto the zero level of a field, with clipped steps (thesis, Eq. 4.6)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from .fields import Differentiable, evaluated

STEPS = 10
LONGEST = 0.1  # of a step, in a frame of radius 1 (released; the thesis's D / (2 |Q|) is 4e-4 for 4,000 points)
FLAT = 1e-12  # the least divisor of a step, a squared length of a gradient


class Projection(NamedTuple):
    """Points after Newton's method, and the field there."""

    points: Tensor  # (n, 3)
    gradients: Tensor  # (n, 3), of the field at the points
    values: Tensor  # (n,), of the field at the points
    evaluations: int  # of the field, at one point each

    def at(self, rows: Tensor | slice) -> Projection:
        """Some of the points, without evaluations."""
        return Projection(self.points[rows], self.gradients[rows], self.values[rows], 0)


def project(
    field: Differentiable,
    points: Tensor,
    *,
    tolerance: float = 1e-5,
    steps: int = STEPS,
    longest: float = LONGEST,
) -> Projection:
    """Move points (n, 3) onto the zero level: ``q - clip(f(q) g(q) / |g(q)|^2)``, until ``|f| <= tolerance``.

    A converged point is not evaluated again. Points that have not converged after ``steps`` are returned too:
    their values show it.

    Parameters
    ----------
    field : Differentiable
    tolerance : float
        Of the field's value, in its units (lengths, where its gradient has length 1).
    longest : float
        Of a step: networks of sines and of encoded positions have gradients that send a full step far away.
    """
    points = points.detach().clone()
    values, gradients = evaluated(field, points)
    evaluations = len(points)
    for _ in range(steps):
        moving = torch.nonzero(values.abs() > tolerance)[:, 0]
        if not len(moving):
            break
        f, g = values[moving], gradients[moving]
        step = f[:, None] * g / g.square().sum(1, keepdim=True).clamp(min=FLAT)
        points[moving] -= clipped(step, longest)
        values[moving], gradients[moving] = evaluated(field, points[moving])
        evaluations += len(moving)
    return Projection(points, gradients, values, evaluations)


def clipped(vectors: Tensor, longest: float | Tensor) -> Tensor:
    """Vectors (n, 3) shortened to a length (a number or (n, 1)): the function tau of Eq. 4.6."""
    length = torch.linalg.vector_norm(vectors, dim=1, keepdim=True)
    return vectors * torch.clamp(longest / length.clamp(min=1e-30), max=1.0)
