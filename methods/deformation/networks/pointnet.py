"""Encodes a set of points: layers on each point, and the maximum of each channel."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class PointNet(nn.Module):
    """The encoder of Qi et al. 2017 without its transforms: (b, n, 3) to (b, c).

    Parameters
    ----------
    sizes : sequence of int
        Channels of the layers, the first of them 3.
    normalised : bool
        Whether each layer is followed by a :class:`BatchNorm`.
    last : bool
        Whether the last layer has a relu.
    """

    def __init__(self, sizes: tuple[int, ...], normalised: bool = False, last: bool = True):
        super().__init__()
        pairs = zip(sizes, sizes[1:], strict=False)
        layers = [layer for inputs, outputs in pairs for layer in dense(inputs, outputs, normalised)]
        self.layers = nn.Sequential(*(layers if last else layers[:-1]))

    def forward(self, points: Tensor) -> Tensor:
        """The code of each set; the order of the points does not matter."""
        return self.layers(points).amax(1)


def dense(inputs: int, outputs: int, normalised: bool) -> nn.Sequential:
    """A linear layer on the last axis, an optional normalisation, and a relu."""
    return nn.Sequential(nn.Linear(inputs, outputs), *([BatchNorm(outputs)] if normalised else []), nn.ReLU())


class BatchNorm(nn.BatchNorm1d):
    """Batch normalisation of the last axis: each channel over all points of all shapes."""

    def forward(self, x: Tensor) -> Tensor:
        """(..., c) to the same shape."""
        return super().forward(x.reshape(-1, x.shape[-1])).reshape(x.shape)


def wide(channels: int, width: float) -> int:
    """The scaled number of channels of a published layer, at least two."""
    return max(2, round(channels * width))


@torch.no_grad()
def draw_balanced(module: nn.Module, generator: torch.Generator | None) -> None:
    """Weights of all linear layers from U(+-sqrt(6 / (inputs + outputs))), Glorot and Bengio's, and biases of 0."""
    for layer in module.modules():
        if isinstance(layer, nn.Linear):
            nn.init.xavier_uniform_(layer.weight, generator=generator)
            nn.init.zeros_(layer.bias)
