"""The appearance of a surface under unknown lights: a small network."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F


class Appearance(nn.Module):
    """Colours of points from position, normal and viewing direction (Yariv et al. 2020, without features of the field).

    Parameters
    ----------
    width : int
        Of its three layers.
    generator : torch.Generator
        The weights are drawn from it, on the CPU.
    """

    FASTER = 10.0  # times the learning rate of the field
    BANDS = 4  # of the encoding of positions: sines and cosines of 1, 2, 4 and 8 pi

    def __init__(self, width: int, generator: torch.Generator):
        super().__init__()
        sizes = [3 + 6 * self.BANDS + 3 + 3, width, width, width, 3]
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for fan_in, fan_out in zip(sizes, sizes[1:], strict=False):
            bound = math.sqrt(3 / fan_in) if fan_out == 3 else math.sqrt(6 / fan_in)
            self.weights.append(nn.Parameter(torch.empty(fan_out, fan_in).uniform_(-bound, bound, generator=generator)))
            self.biases.append(nn.Parameter(torch.zeros(fan_out)))

    def forward(self, points: Tensor, normals: Tensor, directions: Tensor) -> Tensor:
        """Colours (n, 3), 0..1, of points, unit normals and unit directions of view, (n, 3) each."""
        waves = [wave(math.pi * 2**band * points) for band in range(self.BANDS) for wave in (torch.sin, torch.cos)]
        h = torch.cat([points, *waves, normals, directions], dim=1)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            h = F.relu(F.linear(h, weight, bias))
        return torch.sigmoid(F.linear(h, self.weights[-1], self.biases[-1]))
