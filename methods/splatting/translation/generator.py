"""The network that translates an image into another one of the same size (thesis 3.2.5; Johnson et al. 2016)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional as F

Normalisation = Literal["pixel", "batch"]
BLOCKS = 9
WEIGHTS = 0.02  # standard deviation of the initial weights
LEAST = 8  # pixels along each side that the network needs
NOTHING = 1e-4  # weight of the drawn pixels near one, below which they do not determine its colour
MULTIPLE = 4  # the sides must be multiples of this


class PixelNorm(nn.Module):
    """Each pixel's features, divided by the root of the mean of their squares; no parameters."""

    def forward(self, features: Tensor) -> Tensor:
        """(b, c, h, w) to the same shape."""
        return features * torch.rsqrt(features.square().mean(1, keepdim=True) + 1e-8)


class Dropout(nn.Module):
    """Sets a share of the numbers to zero during training.

    The one of torch draws from global state; this one draws from ``generator``, which the training sets for each step.
    """

    generator: torch.Generator | None = None

    def __init__(self, share: float):
        super().__init__()
        self.share = share

    def forward(self, features: Tensor) -> Tensor:
        """(b, c, h, w) to the same shape."""
        if not self.training or not self.share:
            return features
        drawn = torch.rand(features.shape, generator=self.generator, device=features.device)
        return features * (drawn >= self.share) / (1 - self.share)


class Block(nn.Module):
    """Two convolutions, added to the input."""

    def __init__(self, channels: int, dropout: float, normal: Callable[[int], nn.Module]):
        super().__init__()
        self.layers = nn.Sequential(
            *_around(1, nn.Conv2d(channels, channels, 3, bias=False)),
            *(normal(channels), nn.ReLU(), Dropout(dropout)),
            *_around(1, nn.Conv2d(channels, channels, 3, bias=False)),
            normal(channels),
        )

    def forward(self, features: Tensor) -> Tensor:
        """(b, c, h, w) to the same shape."""
        return features + self.layers(features)


class Generator(nn.Module):
    """A residual network of nine blocks at a quarter of the resolution; 11,372,931 parameters for 64 channels.

    As released: reflected borders, features normalised pixel by pixel, no biases except the last one. Input and output
    images have 0.5 as the middle of their range. The normalisations have no parameters.

    Parameters
    ----------
    channels : int
        Of the first layer; the blocks have four times as many.
    dropout : float
        Share of the numbers in each block that is set to zero in training.
    smoothing : float
        Pixels. The output of the layers is added to the image smoothed by a Gaussian of this deviation, and is 0 before
        training; gaps in the image are filled for the layers. With 0 the output is the image, as released.
    normalisation : "pixel" or "batch"
        Each pixel by itself, as released; or each channel over all pixels of a batch, which learns in fewer steps.
    generator : torch.Generator, optional
        The weights are drawn from it, on the CPU.
    """

    def __init__(
        self,
        channels: int = 64,
        dropout: float = 0.0,
        smoothing: float = 0.0,
        normalisation: Normalisation = "pixel",
        generator: torch.Generator | None = None,
    ):
        super().__init__()
        self.smoothing = smoothing
        one, two, four = channels, 2 * channels, 4 * channels

        def normal(count: int) -> nn.Module:
            return PixelNorm() if normalisation == "pixel" else nn.BatchNorm2d(count, affine=False)

        def up(before: int, after: int) -> nn.Module:
            return nn.ConvTranspose2d(before, after, 3, stride=2, padding=1, output_padding=1, bias=False)

        self.layers = nn.Sequential(
            *(*_around(3, nn.Conv2d(3, one, 7, bias=False)), normal(one), nn.ReLU()),
            *(nn.Conv2d(one, two, 3, stride=2, padding=1, bias=False), normal(two), nn.ReLU()),
            *(nn.Conv2d(two, four, 3, stride=2, padding=1, bias=False), normal(four), nn.ReLU()),
            *(Block(four, dropout, normal) for _ in range(BLOCKS)),
            *(up(four, two), normal(two), nn.ReLU()),
            *(up(two, one), normal(one), nn.ReLU()),
            *(*_around(3, nn.Conv2d(one, 3, 7)), nn.Tanh()),
        )
        draw_weights(self, generator)
        if smoothing:
            last = self.layers[-2]
            assert isinstance(last, nn.Conv2d)
            nn.init.zeros_(last.weight)

    def forward(self, images: Tensor) -> Tensor:
        """Images (b, 3, h, w) to others of the same size, for any size."""
        height, width = images.shape[2:]
        right, down = (max(LEAST, -(-side // MULTIPLE) * MULTIPLE) - side for side in (width, height))
        if right or down:
            images = F.pad(images, (0, right, 0, down), mode="replicate")
        if self.smoothing:
            smooth = smoothed(images, self.smoothing)
            filled = torch.where((images > 0).any(1, keepdim=True), images, smooth)
            made = self.layers(filled - 0.5) + smooth
        else:
            made = self.layers(images - 0.5) + 0.5
        return made[:, :, :height, :width]

    def draw_dropout_from(self, generator: torch.Generator) -> None:
        """Draw dropout from a generator, on the device of the network, from now on."""
        for module in self.modules():
            if isinstance(module, Dropout):
                module.generator = generator


def smoothed(images: Tensor, deviation: float) -> Tensor:
    """Means of the drawn pixels, weighted by a Gaussian; 0.5 if none is near.

    Parameters
    ----------
    images : (b, 3, h, w) tensor
        0 in the background.
    deviation : float
        In pixels; the Gaussian is cut off at three of it.
    """
    reach = math.ceil(3 * deviation)
    along = torch.arange(-reach, reach + 1, device=images.device, dtype=images.dtype)
    bell = torch.exp(-((along / deviation) ** 2) / 2)
    bell = bell / bell.sum()
    covered = (images > 0).any(1, keepdim=True).to(images.dtype)
    sums = torch.cat([images * covered, covered], dim=1)
    rows, columns = bell.expand(4, 1, 1, -1), bell[:, None].expand(4, 1, -1, 1)
    sums = F.conv2d(F.conv2d(sums, rows, padding=(0, reach), groups=4), columns, padding=(reach, 0), groups=4)
    total = sums[:, 3:]
    return torch.where(total > NOTHING, sums[:, :3] / total.clamp_min(NOTHING), 0.5)


def draw_weights(network: nn.Module, generator: torch.Generator | None) -> None:
    """Normally distributed weights with deviation 0.02, and no biases, as published."""
    with torch.no_grad():
        for parameter in network.parameters():
            if parameter.dim() > 1:
                parameter.normal_(0, WEIGHTS, generator=generator)
            else:
                parameter.zero_()


def _around(pixels: int, convolution: nn.Module) -> tuple[nn.Module, nn.Module]:
    return nn.ReflectionPad2d(pixels), convolution
