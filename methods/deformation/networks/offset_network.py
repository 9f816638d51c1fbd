"""The network of 3DN: maps the codes of both shapes and a point to the offset of the point."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .pointnet import PointNet, draw_balanced, wide


class OffsetNetwork(nn.Module):
    """Two encoders, and three decoders, each of which folds the output of the one before (Wang et al. 2019).

    8,046,089 parameters at width 1, as released except for the batch normalisation, which is omitted. The input of the
    first decoder are the coordinates of a point, of the second the three numbers of the first, of the third those of
    both; each also gets the codes of the two shapes. The last layer starts at 0, so that training starts at the
    identity.

    Parameters
    ----------
    width : float
        Factor of all channels.
    generator : torch.Generator
        The weights are drawn from it, on the CPU.
    """

    def __init__(self, width: float = 1.0, generator: torch.Generator | None = None):
        super().__init__()
        code = wide(1024, width)
        sizes = (3, *[wide(64, width)] * 3, wide(128, width), code)
        self.encoders = nn.ModuleList(
            nn.Sequential(PointNet(sizes), nn.Linear(code, code), nn.ReLU(), nn.Linear(code, code), nn.ReLU())
            for _ in range(2)
        )
        folds = [_Fold(inputs, 2 * code, width) for inputs in (3, 3, 6)]
        self.folds = nn.ModuleList(folds)
        draw_balanced(self, generator)
        nn.init.zeros_(folds[-1].last.weight)
        nn.init.zeros_(folds[-1].last.bias)

    def encode(self, source: Tensor, target: Tensor) -> Tensor:
        """Point sets (b, n, 3) and (b, m, 3) to the codes (b, c) of the pairs."""
        return torch.cat([self.encoders[0](source), self.encoders[1](target)], dim=1)

    def forward(self, points: Tensor, code: Tensor) -> Tensor:
        """The new positions of points (b, n, 3) of the sources."""
        first, second, third = self.folds
        once = first(points, code)
        return points + third(torch.cat([second(once, code), once], dim=2), code)


class _Fold(nn.Module):
    """Three layers on (x, code); the part of the code in the first layer is the same for all points of a shape."""

    def __init__(self, inputs: int, code: int, width: float):
        super().__init__()
        self.inputs = inputs
        self.first = nn.Linear(inputs + code, wide(512, width))
        self.second = nn.Linear(wide(512, width), wide(256, width))
        self.last = nn.Linear(wide(256, width), 3)

    def forward(self, x: Tensor, code: Tensor) -> Tensor:
        of_point, of_code = self.first.weight.split([self.inputs, code.shape[1]], dim=1)
        h = F.linear(x, of_point) + F.linear(code, of_code, self.first.bias)[:, None]
        return self.last(F.relu(self.second(F.relu(h))))
