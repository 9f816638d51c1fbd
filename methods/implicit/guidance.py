"""Guidance: guesses of the distance in space, which tell a field early which side is inside.

Eq. 4.4 tells inside from outside at the points alone; in space, exp(-100 |f|) is as content with a wrong sign as with
the right one. Walls that the initial sphere leaves there, or that a high frequency grows, cost little, and stay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from .losses import OrientedLoss
from .sampling import Batch, Sampler
from .spectral_poisson import evenly, indicator, interpolate, to_lattice

WEIGHT = 400.0  # of the guessed distances


def guided_loss(loss: OrientedLoss, f: Tensor, gradient: Tensor, batch: Batch, guided: bool) -> Tensor:
    """Eq. 4.4; where ``guided``, the error of guessed distances takes the place of its term for the space.

    What is not known (NaN) costs nothing. A batch without guesses is judged by Eq. 4.4 alone.
    """
    if not guided or batch.distances is None:
        return loss(f, gradient, batch)
    guessed = batch.distances.where(~batch.distances.isnan(), f.detach())
    error = (f - guessed)[batch.on :].abs().sum() / batch.total
    return replace(loss, space=0.0)(f, gradient, batch) + WEIGHT * error


class GuidedSampler(Sampler):
    """Oriented points, and uniform points of space with guesses of their distances.

    The distance is that to the nearest point, the sign that of a coarse Poisson indicator of the points; it is NaN
    where that is not clear.
    """

    LATTICE, UNCLEAR = 64, 0.1  # nodes along an axis; the indicator is +-1/2 away from the surface
    ENOUGH, TOLERANCE = 20_000, 0.05  # points of the input; relative error of distances to them

    def __init__(
        self, points: np.ndarray, normals: np.ndarray, batch: int, generator: torch.Generator, *, count: int = 1 << 16
    ):
        from scipy.spatial import cKDTree

        super().__init__(points, normals, batch, generator)
        device = generator.device
        some = torch.randperm(len(points), generator=generator, device=device)[: self.ENOUGH]
        known = self._points[some]
        chi = indicator(known, self._normals[some] * evenly(known)[:, None], self.LATTICE, sigma=2.0)
        self._space = torch.rand(count, 3, generator=generator, device=device) * 2 - 1
        chi = interpolate(chi, to_lattice(self._space, self.LATTICE))
        distances = cKDTree(known.cpu().numpy()).query(self._space.cpu().numpy(), eps=self.TOLERANCE)[0]
        distances = torch.as_tensor(distances).to(chi)
        self._distances = torch.where(chi.abs() > self.UNCLEAR, distances * chi.sign(), torch.nan)

    def draw(self) -> Batch:
        """The next batch."""
        device = self._generator.device
        rows = torch.randint(len(self._points), (self._batch,), generator=self._generator, device=device)
        space = torch.randint(len(self._space), (self._batch,), generator=self._generator, device=device)
        x = torch.cat([self._points[rows], self._space[space]])
        on = torch.zeros(self._batch, device=device)
        return Batch(x, self._batch, self._normals[rows], torch.cat([on, self._distances[space]]), len(x))
