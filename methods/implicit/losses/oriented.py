"""The losses: Eq. 4.4 for oriented points, and the one for true distances."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from ...learned.training.batches import Batch

STEEPNESS = 100.0  # of exp(-100 |f|)


@dataclass(frozen=True)
class OrientedLoss:
    """Eq. 4.4: an eikonal field that vanishes on the points, with their normals, and nowhere else.

    Each term is summed over its points and divided by the number of *all* points of the step, as in the released code.
    The term for the space is exp(-100 |f|): the thesis prints it without the absolute value, which would reward points
    far inside. Normals are compared by cosine, as in the released code; the thesis prints the inner product with the
    gradient itself.
    """

    surface: float = 400.0  # lambda_1
    space: float = 50.0  # lambda_3
    eikonal: float = 5.0  # lambda_0
    normal: float = 40.0  # lambda_2

    def __call__(self, f: Tensor, gradient: Tensor, batch: Batch) -> Tensor:
        """The loss of values (n,) and gradients (n, 3) at the points of ``batch``."""
        on = batch.on
        length = torch.linalg.vector_norm(gradient, dim=1)
        loss = self.eikonal * (length - 1).abs().sum()
        loss = loss + self.surface * f[:on].abs().sum()
        loss = loss + self.normal * (1 - F.cosine_similarity(gradient[:on], batch.normals)).sum()
        loss = loss + self.space * torch.exp(-STEEPNESS * f[on:].abs()).sum()
        return loss / batch.total


def squared_error(f: Tensor, batch: Batch) -> Tensor:
    """The mean squared error of values (n,) against the true distances."""
    assert batch.distances is not None
    return (f - batch.distances).square().sum() / batch.total
