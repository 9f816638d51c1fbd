"""The training of control grids: points that are to meet, or volumes that are to agree, and grids that are even."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ..networks.grid_network import monotone, occupancy, spacing, warp
from .pair_training import PairTraining, crossed
from .terms import chamfer, squared


class GridTraining(PairTraining):
    """Alignment and evenness: see :class:`bench.methods.deformation.alignnet.Alignnet`."""

    def terms(self, shapes: Tensor, rng: np.random.Generator, done: float) -> Tensor:
        """See :meth:`.pair_training.PairTraining.terms`."""
        batch = crossed(shapes)
        increments = self.network.increments(batch.source, batch.seen)
        grid, others = monotone(increments), len(increments) - batch.own
        moved = warp(grid, batch.source)
        loss = squared(moved[others:], batch.target[others:])
        if self.plan.alignment == "points":
            loss = loss + chamfer(moved[:others], batch.target[:others])
        else:
            loss = loss + disagreement(grid[:others], batch.source[:others], batch.target[:others], self.plan.voxels)
        return loss + self.plan.even * (increments.abs() - spacing(self.plan.cells)).abs().mean()


def disagreement(grid: Tensor, source: Tensor, target: Tensor, voxels: int) -> Tensor:
    """The mean smooth L1 distance of the source's volume and the target's, looked up where the grid takes the cells.

    So the grid takes the source forwards, as the released code does for volumes.

    Parameters
    ----------
    grid : (b, 3, c, c, c) tensor
    source, target : (b, n, 3) tensors
    voxels : int
    """
    centers = (torch.arange(voxels, device=grid.device) + 0.5) * (2 / voxels) - 1
    places = torch.cartesian_prod(centers, centers, centers)[None].expand(len(grid), -1, -1)
    there = warp(grid, places).flip(2)[:, :, None, None]  # grid_sample names the last axis first
    found = F.grid_sample(occupancy(target, voxels)[:, None], there, align_corners=False)
    return F.smooth_l1_loss(found.flatten(1), occupancy(source, voxels).flatten(1))
