"""The network of EC-Net (Yu et al. 2018b): maps a patch to four times as many points and their distances to edges."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .dense_features import Pointwise
from .pu_network import RATIO
from .set_abstraction import Branches, PointFeatures

RADII = (0.1, 0.2, 0.4, 0.6)  # of the balls of the four levels, in radii of a patch of 1,024 points
SAMPLES = (12, 32, 32, 32)


class EcNetwork(nn.Module):
    """Features of all points at four scales; four branches for the half of the points that lies nearest the seed.

    The other half is context: the neighbourhoods of points extend into it.

    Parameters
    ----------
    widening : float
        Factor of the published radii: patches of fewer points have wider gaps.
    generator : torch.Generator, optional
        The weights are drawn from it, on the CPU.

    Notes
    -----
    823,652 parameters.
    """

    def __init__(self, widening: float = 1.0, generator: torch.Generator | None = None):
        super().__init__()
        self.features = PointFeatures(tuple(widening * radius for radius in RADII), SAMPLES, generator)
        self.branches = Branches(self.features.outputs, RATIO, generator)
        width = self.branches.outputs
        self.first_of_distance, self.last_of_distance = Pointwise(width, 64, generator), Pointwise(64, 1, generator)
        self.first, self.last = Pointwise(width + 64, 64, generator), Pointwise(64, 3, generator)

    def forward(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """New points, and their distances to the nearest edge.

        Parameters
        ----------
        points : (3, b, n) tensor
            Of normalised patches, nearest the seed first.

        Returns
        -------
        points : (3, b, 4 m) tensor, m = n / 2 rounded up
            Predicted offsets, added to the repeated points.
        distances : (b, 4 m) tensor
        """
        kept = cropped(points.shape[2])
        copies = self.branches(self.features(points)[:, :, :kept])
        of_distance = F.relu(self.first_of_distance(copies))
        offsets = self.last(F.relu(self.first(torch.cat([copies, of_distance]))))
        return points[:, :, :kept].repeat(1, 1, RATIO) + offsets, self.last_of_distance(of_distance)[0]


def cropped(points: int) -> int:
    """The number of points of a patch that are upsampled."""
    return -(-points // 2)
