"""The network of PU-Net (Yu et al. 2018): maps a patch to several times as many points."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .dense_features import Pointwise
from .set_abstraction import Branches, PointFeatures

RATIO = 4
POINTS = 1024  # of a patch of the published radii
RADII = (0.05, 0.1, 0.2, 0.3)  # of the balls of the four levels, in radii of the patch


class PuNetwork(nn.Module):
    """Features at four scales, four branches, and coordinates.

    Parameters
    ----------
    widening : float
        Factor of the published radii: patches of fewer points have wider gaps.
    generator : torch.Generator, optional
        The weights are drawn from it, on the CPU.
    times : int
        Number of branches, one for each copy of the points.

    Notes
    -----
    814,307 parameters with four branches.
    """

    def __init__(self, widening: float = 1.0, generator: torch.Generator | None = None, times: int = RATIO):
        super().__init__()
        self.features = PointFeatures(tuple(widening * radius for radius in RADII), generator=generator)
        self.branches = Branches(self.features.outputs + 3, times, generator)
        self.first = Pointwise(self.branches.outputs, 64, generator)
        self.last = Pointwise(64, 3, generator)

    def forward(self, points: Tensor) -> Tensor:
        """Points (3, b, n) of normalised patches to (3, b, times * n): the coordinates themselves, not offsets."""
        copies = self.branches(torch.cat([self.features(points), points]))
        return self.last(F.relu(self.first(copies)))
