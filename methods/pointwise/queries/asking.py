"""The network's signed distances at many queries."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn

from bench import Run

from .inputs import patches_of, wholes_of

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

TOGETHER = 128  # queries in one call of the network


@dataclass(frozen=True, eq=False)
class Asking:
    """A cloud, and a network that is evaluated near it."""

    network: nn.Module  # (b, size, 3) patches and (b, subsample, 3) wholes to distances and logits
    points: np.ndarray  # (n, 3) float64
    unit: float  # the radius of the cloud
    size: int  # points of a patch; if the cloud has fewer, all of them with repetitions
    subsample: int  # points of a whole
    near: bool  # whether each query has a whole of its own
    run: Run

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(self.points)

    @torch.no_grad()
    def __call__(self, places: np.ndarray) -> np.ndarray:
        """Signed distances (m,) at places (m, 3), negative inside."""
        found, device = [], self.run.device
        count = min(self.size, len(self.points))
        # The queries of all calls share one whole.
        rng = np.random.default_rng([self.run.seed, len(self.points)])
        shared = None if self.near else wholes_of(self.points, np.zeros((1, 3)), self.subsample, False, 1.0, rng)
        for first in range(0, len(places), TOGETHER):
            some = places[first : first + TOGETHER]
            nearest = self._tree.query(some, np.arange(1, count + 1))[1][:, np.arange(self.size) % count]
            patches, radii = patches_of(self.points, nearest, some)
            if shared is None:
                wholes = wholes_of(self.points, some, self.subsample, True, self.unit, rng)
            else:
                wholes = ((shared - some[:, None]) / self.unit).astype(np.float32)
            given = (torch.from_numpy(array).to(device) for array in (patches, wholes))
            distances, logits = (answer.double().cpu().numpy() for answer in self.network(*given))
            found.append(np.where(logits > 0, -1.0, 1.0) * distances * radii)
            self.run.progress(first + len(some), len(places))
        return np.concatenate(found) if found else np.empty(0)
