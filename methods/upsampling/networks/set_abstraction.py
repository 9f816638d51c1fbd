"""The hierarchical point features of PU-Net and EC-Net: four levels of PointNet++ (Qi et al. 2017) joined."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .dense_features import Pointwise
from .grouping import ball_query, farthest_order, interpolate
from .neighbours import gather

WIDTHS = ((32, 32, 64), (64, 64, 128), (128, 128, 256), (256, 256, 512))
RESTORED = 64  # channels of each level, interpolated to all points


class SetAbstraction(nn.Module):
    """The maximum over a ball around each query of features by three layers on the neighbours.

    A neighbour's input is its position relative to the query, and its features.

    Parameters
    ----------
    radius : float
        Of the ball, in the unit of the points.
    samples : int
        Neighbours of a query, at most.
    inputs : int
        Channels of the features; 0 for none.
    widths : tuple of int
        Channels of the layers.
    generator : torch.Generator, optional
        The weights are drawn from it, on the CPU.
    """

    def __init__(
        self,
        radius: float,
        samples: int,
        inputs: int,
        widths: tuple[int, ...],
        generator: torch.Generator | None = None,
    ):
        super().__init__()
        self.radius, self.samples = radius, samples
        self.layers = nn.ModuleList(
            Pointwise(a, b, generator) for a, b in zip((3 + inputs, *widths[:-1]), widths, strict=True)
        )

    def forward(self, points: Tensor, features: Tensor | None, count: int) -> Tensor:
        """Features (widths[-1], b, count) of the first ``count`` of the points (3, b, n) with features (c, b, n)."""
        queries = points[:, :, :count]
        index = ball_query(queries, points, self.radius, self.samples)
        # W [p_j - p_i, f_j] = W [p_j, f_j] - W_p p_i: the first layer once for each point, not for each neighbour.
        first = self.layers[0]
        assert isinstance(first, Pointwise)
        own = first(points if features is None else torch.cat([points, features]))
        shift = (first.weight[:, :3] @ queries.reshape(3, -1)).reshape(len(own), -1, 1, count)
        x = F.relu(gather(own, index) - shift)
        for layer in self.layers[1:]:
            x = F.relu(layer(x))
        return x.amax(2)


class PointFeatures(nn.Module):
    """Features of the points of a patch at four scales.

    The four levels have 1, 1/2, 1/4 and 1/8 of the points, farthest points of the patch. The upper three are brought to
    all points by interpolation and a layer of 64 channels each (Yu et al. 2018, section 3.2).

    Parameters
    ----------
    radii : four floats
        Of the balls, in the unit of the points.
    samples : four ints
        Neighbours of a query at each level, at most.
    generator : torch.Generator, optional

    Notes
    -----
    408,032 parameters.
    """

    outputs = 3 * RESTORED + WIDTHS[0][-1]

    def __init__(
        self,
        radii: tuple[float, ...],
        samples: tuple[int, ...] = (32, 32, 32, 32),
        generator: torch.Generator | None = None,
    ):
        super().__init__()
        inputs = (0, *(widths[-1] for widths in WIDTHS[:-1]))
        self.levels = nn.ModuleList(
            SetAbstraction(*level, generator) for level in zip(radii, samples, inputs, WIDTHS, strict=True)
        )
        self.restore = nn.ModuleList(Pointwise(widths[-1], RESTORED, generator) for widths in WIDTHS[:0:-1])

    def forward(self, points: Tensor) -> Tensor:
        """Points (3, b, n) of normalised patches to features (256, b, n): from the coarsest level to the finest."""
        n = points.shape[2]
        order = farthest_order(points)
        inverse = order.argsort(1)[:, None]
        points = gather(points, order[:, None])[:, :, 0]
        features, known = None, []
        for level, module in enumerate(self.levels):
            finer = max(1, n >> max(0, level - 1))
            features = module(points[:, :, :finer], features, max(1, n >> level))
            known.append(features)
        restored = [
            F.relu(layer(interpolate(points, points[:, :, : coarse.shape[2]], coarse)))
            for layer, coarse in zip(self.restore, known[:0:-1], strict=True)
        ]
        return gather(torch.cat([*restored, known[0]]), inverse)[:, :, 0]


class Branches(nn.Module):
    """One copy of each point for each branch, by two layers with their own weights: 256, 128.

    Notes
    -----
    397,824 parameters for four branches on 259 channels, 394,752 on 256.
    """

    outputs = 128

    def __init__(self, inputs: int, copies: int, generator: torch.Generator | None = None):
        super().__init__()
        self.first = nn.ModuleList(Pointwise(inputs, 256, generator) for _ in range(copies))
        self.second = nn.ModuleList(Pointwise(256, self.outputs, generator) for _ in range(copies))

    def forward(self, features: Tensor) -> Tensor:
        """(inputs, b, n) to (128, b, copies * n): all first copies, then all second ones, and so on."""
        pairs = zip(self.first, self.second, strict=True)
        return torch.cat([F.relu(second(F.relu(first(features)))) for first, second in pairs], dim=2)
