"""A small three-dimensional U-Net: propagates features of a surface into the space around it."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .point_encoder import draw_weights

GROUPS = 8  # of the group normalisation


class UNet(nn.Module):
    """Three levels with 16, 32 and 64 channels; the result has as many channels as the input, and no activation.

    256,656 parameters for 16 channels, as in the released code: on each level twice (group normalisation, convolution
    of 3^3 without bias, relu); max pooling over 2^3 cells goes down, nearest-neighbour upsampling goes up and is
    concatenated to the features of that level.

    Parameters
    ----------
    channels : int, a multiple of 8
    generator : torch.Generator
        The weights are drawn from it, on the CPU.
    """

    def __init__(self, channels: int = 16, generator: torch.Generator | None = None):
        super().__init__()
        one, two, four = channels, 2 * channels, 4 * channels
        self.down = nn.ModuleList([_twice(one, one, one), _twice(one, one, two), _twice(two, two, four)])
        self.up = nn.ModuleList([_twice(four + two, two, two), _twice(two + one, one, one)])
        self.last = nn.Conv3d(one, channels, 1)
        draw_weights(self, generator)

    def forward(self, grid: Tensor) -> Tensor:
        """(1, channels, s, s, s) to the same shape; s is a multiple of 4."""
        fine = self.down[0](grid)
        middle = self.down[1](F.max_pool3d(fine, 2))
        coarse = self.down[2](F.max_pool3d(middle, 2))
        middle = self.up[0](torch.cat([middle, F.interpolate(coarse, scale_factor=2)], dim=1))
        fine = self.up[1](torch.cat([fine, F.interpolate(middle, scale_factor=2)], dim=1))
        return self.last(fine)


def _twice(inputs: int, between: int, outputs: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for fan_in, fan_out in ((inputs, between), (between, outputs)):
        layers += [nn.GroupNorm(GROUPS, fan_in), nn.Conv3d(fan_in, fan_out, 3, padding=1, bias=False), nn.ReLU()]
    return nn.Sequential(*layers)
