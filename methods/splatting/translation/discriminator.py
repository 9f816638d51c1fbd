"""The network that classifies each patch of an image as real or generated (Isola et al. 2017)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from .generator import draw_weights


class Discriminator(nn.Module):
    """Classifies patches of 70 x 70 pixels of an image, given the one that it was made from.

    Parameters
    ----------
    channels : int
        Of the first layer.
    generator : torch.Generator, optional
        The weights are drawn from it, on the CPU.
    """

    def __init__(self, channels: int = 64, generator: torch.Generator | None = None):
        super().__init__()
        layers: list[nn.Module] = [nn.Conv2d(6, channels, 4, stride=2, padding=1), nn.LeakyReLU(0.2)]
        for factor, stride in ((1, 2), (2, 2), (4, 1)):
            layers += [
                nn.Conv2d(factor * channels, 2 * factor * channels, 4, stride=stride, padding=1),
                nn.InstanceNorm2d(2 * factor * channels),
                nn.LeakyReLU(0.2),
            ]
        self.layers = nn.Sequential(*layers, nn.Conv2d(8 * channels, 1, 4, padding=1))
        draw_weights(self, generator)

    def forward(self, given: Tensor, image: Tensor) -> Tensor:
        """Logits (b, 1, i, j) of each patch of ``image`` being real; both images are (b, 3, h, w)."""
        return self.layers(torch.cat([given, image], dim=1) - 0.5)
