"""The training of control grids: alignment of points, and evenness of grids."""

from __future__ import annotations

import numpy as np
from torch import Tensor

from ..networks.grid_network import GridNetwork, monotone, spacing, warp
from .pair_training import PairTraining, crossed
from .terms import chamfer, squared


class GridTraining(PairTraining):
    """Alignment and evenness: see :class:`bench.methods.deformation.alignnet.Alignnet`."""

    network: GridNetwork

    def terms(self, shapes: Tensor, rng: np.random.Generator, done: float) -> Tensor:
        """See :meth:`.pair_training.PairTraining.terms`."""
        batch = crossed(shapes)
        increments = self.network.increments(batch.source, batch.seen)
        moved, others = warp(monotone(increments), batch.source), len(increments) - batch.own
        loss = chamfer(moved[:others], batch.target[:others]) + squared(moved[others:], batch.target[others:])
        return loss + self.plan.even * (increments.abs() - spacing(self.plan.cells)).abs().mean()
