"""Guidance: guesses of the distance in space, by which a field learns early which side is inside.

Eq. 4.4 distinguishes inside and outside only at the points; in space, exp(-100 |f|) does not depend on the sign. Walls
that remain there from the initial sphere, or that arise from a high frequency, cost little, and stay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from bench.geometry.neighbours import OrderedPoints

from ...learned.training.batches import Batch, Sampler
from ..spectral.spectral_poisson import evenly, from_lattice, indicator, interpolate, to_lattice
from .oriented import OrientedLoss

WEIGHT = 400.0  # of the guessed distances


def guided_loss(loss: OrientedLoss, f: Tensor, gradient: Tensor, batch: Batch, guided: bool) -> Tensor:
    """Eq. 4.4; if ``guided``, the error of guessed distances replaces its term for the space.

    Unknown distances (NaN) cost nothing. The loss of a batch without guesses is Eq. 4.4.
    """
    if not guided or batch.distances is None:
        return loss(f, gradient, batch)
    guessed = batch.distances.where(~batch.distances.isnan(), f.detach())
    error = (f - guessed)[batch.on :].abs().sum() / batch.total
    return replace(loss, space=0.0)(f, gradient, batch) + WEIGHT * error


class GuidedSampler(Sampler):
    """Oriented points, and uniform points of space with guesses of their distances.

    The distance is that to the nearest point, the sign that of a coarse Poisson indicator of the points. Both are
    computed at the nodes of a lattice and interpolated between them; a guess is NaN if its sign is not clear.
    """

    LATTICE, UNCLEAR = 64, 0.1  # nodes along an axis; the indicator is +-1/2 away from the surface
    ENOUGH = 20_000  # points of the input

    def __init__(self, points: np.ndarray, normals: np.ndarray, batch: int, generator: torch.Generator):
        super().__init__(points, normals, batch, generator)
        some = torch.randperm(len(points), generator=generator, device=generator.device)[: self.ENOUGH]
        known = self._points[some]
        self._chi = indicator(known, self._normals[some] * evenly(known)[:, None], self.LATTICE, sigma=2.0)
        nodes = from_lattice(torch.cartesian_prod(*3 * [torch.arange(self.LATTICE)]), self.LATTICE)
        distances = OrderedPoints(nodes.numpy()).nearest_in(OrderedPoints(known.cpu().numpy())).distance
        # A signed distance is linear across the surface, where its absolute value has a kink.
        self._distances = torch.as_tensor(distances).to(self._chi).view_as(self._chi) * self._chi.sign()

    def draw(self) -> Batch:
        """The next batch."""
        batch = super().draw()
        on, space = batch.x.new_zeros(batch.on), batch.x[batch.on :]
        return replace(batch, distances=torch.cat([on, self.guess(space)]))

    def guess(self, space: Tensor) -> Tensor:
        """Signed distances (n,) of points (n, 3) of the box, or NaN."""
        places = to_lattice(space, self.LATTICE)
        clear = interpolate(self._chi, places).abs() > self.UNCLEAR
        return interpolate(self._distances, places).where(clear, torch.nan)
