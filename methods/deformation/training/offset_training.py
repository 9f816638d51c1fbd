"""The training of offsets: the terms of 3DN."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..networks.offset_network import OffsetNetwork
from .pair_training import PairTraining, crossed
from .terms import chamfer, earth_mover, laplacian_change, squared

STEP = 0.005  # between two points that must keep their order
PART = 128  # points that represent all in the terms of order and of shape
AXES = "xyz"


class OffsetTraining(PairTraining):
    """Alignment, symmetry, order and shape: see :class:`bench.methods.deformation.three_dn.ThreeDn`."""

    network: OffsetNetwork

    def terms(self, shapes: Tensor, rng: np.random.Generator, done: float) -> Tensor:
        """See :meth:`.pair_training.PairTraining.terms`."""
        plan, batch = self.plan, crossed(shapes)
        code = self.network.encode(batch.source, batch.seen)
        moved = self.network(batch.source, code)
        others = len(moved) - batch.own
        given, wanted = moved[:others], batch.target[:others]
        loss = chamfer(given, wanted) + squared(moved[others:], batch.target[others:])
        if plan.mirror:
            loss = loss + plan.mirror * chamfer(mirrored(given, plan.plane), wanted)
        if plan.earth_mover:
            loss = loss + plan.earth_mover * earth_mover(given[:, : plan.matched], wanted[:, : plan.matched])
        if plan.order:
            loss = loss + plan.order * self._disorder(batch.source[:, :PART], moved[:, :PART], code, rng)
        if plan.laplacian:
            loss = loss + plan.laplacian * laplacian_change(batch.source, moved, PART, plan.neighbours)
        return loss

    def _disorder(self, points: Tensor, moved: Tensor, code: Tensor, rng: np.random.Generator) -> Tensor:
        """How far a small step along an axis is reversed, summed over three axes and averaged over both directions.

        Each point takes one random step of the six.
        """
        axis = torch.from_numpy(rng.integers(3, size=points.shape[:2])).to(points.device)[:, :, None]
        sign = torch.from_numpy(rng.choice([-1.0, 1.0], size=(*points.shape[:2], 1)).astype(np.float32)).to(points)
        aside = self.network(points + torch.zeros_like(points).scatter(2, axis, STEP * sign), code)
        return 6 * torch.relu(-sign * (aside - moved).gather(2, axis)).mean()


def mirrored(points: Tensor, plane: str) -> Tensor:
    """Points (b, n, 3) with the sign of one coordinate changed, that named by its letter."""
    signs = points.new_ones(3)
    signs[AXES.index(plane)] = -1
    return points * signs
