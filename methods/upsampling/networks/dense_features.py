"""Features of the points of a patch by densely connected layers of edges between neighbours in feature space."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .neighbours import gather, nearest_others

BLOCKS = 4


class Pointwise(nn.Linear):
    """A linear layer on each point of (c, b, n), with Xavier's uniform weights and biases 0.

    Parameters
    ----------
    inputs, outputs : int
    generator : torch.Generator, optional
        The weights are drawn from it, on the CPU.
    """

    def __init__(self, inputs: int, outputs: int, generator: torch.Generator | None = None):
        super().__init__(inputs, outputs)
        with torch.no_grad():
            nn.init.xavier_uniform_(self.weight, generator=generator)
            self.bias.zero_()

    def forward(self, x: Tensor) -> Tensor:
        """(inputs, ...) to (outputs, ...)."""
        return torch.addmm(self.bias[:, None], self.weight, x.reshape(len(x), -1)).reshape(-1, *x.shape[1:])


class DenseBlock(nn.Module):
    """Layers on the edges [x_i, x_j - x_i] from each point to its nearest in the space of the features x.

    The input of each layer are the outputs of all before it and x_i; a point gets the maximum over its neighbours
    (Wang et al. 2019, section 3.2). No tensor over the edges has more than ``growth`` channels: the first
    layer is W_a x_i + W_b (x_j - x_i) = (W_a - W_b) x_i + W_b x_j, and the part of x_i in later layers is the same
    for all edges of a point. Up to rounding this equals the layers on tiled edges, in less than half the time.

    Parameters
    ----------
    inputs : int
        Channels of x.
    growth : int
        Channels of each layer.
    layers : int
        The last of them has no activation.
    neighbours : int
    """

    def __init__(
        self, inputs: int, growth: int, layers: int, neighbours: int, generator: torch.Generator | None = None
    ):
        super().__init__()
        self.neighbours = neighbours
        self.outputs = inputs + growth * layers
        widths = [2 * inputs, *(inputs + growth * done for done in range(1, layers))]
        self.layers = nn.ModuleList(Pointwise(width, growth, generator) for width in widths)

    def forward(self, x: Tensor) -> Tensor:
        """(inputs, b, n) to (outputs, b, n): the last layer's part first, x last."""
        c, b, n = x.shape
        index = nearest_others(x, self.neighbours)
        points = x.reshape(c, -1)
        first = self.layers[0]
        assert isinstance(first, Pointwise)
        own, other = first.weight[:, :c], first.weight[:, c:]
        start = torch.addmm(first.bias[:, None], own - other, points).reshape(-1, b, 1, n)
        value = gather((other @ points).reshape(-1, b, n), index) + start
        parts = [x]  # newest first
        made: list[Tensor] = []  # likewise
        for layer in self.layers[1:]:
            assert isinstance(layer, Pointwise)
            value = value.relu_()
            parts.insert(0, value.amax(2))
            made.insert(0, value.reshape(len(value), -1))
            *edges, of_point = layer.weight.split([len(part) for part in made] + [c], dim=1)
            product = edges[0] @ made[0]
            for weight, part in zip(edges[1:], made[1:], strict=True):
                product.addmm_(weight, part)
            start = torch.addmm(layer.bias[:, None], of_point, points).reshape(-1, b, 1, n)
            value = product.reshape(-1, b, index.shape[1], n) + start
        return torch.cat([value.amax(2), *parts])


class DenseFeatures(nn.Module):
    """Four dense blocks, each on the features of all before it: 264 channels with the defaults.

    Parameters
    ----------
    growth : int
        Channels of a layer; blocks take twice as many.
    layers : int
        Of each block.
    neighbours : int
        In feature space.
    generator : torch.Generator, optional

    Notes
    -----
    17,016 parameters with the defaults.
    """

    def __init__(
        self, growth: int = 12, layers: int = 3, neighbours: int = 32, generator: torch.Generator | None = None
    ):
        super().__init__()
        width = 2 * growth
        self.first = Pointwise(3, width, generator)
        blocks = [DenseBlock(width, growth, layers, neighbours, generator) for _ in range(BLOCKS)]
        self.blocks = nn.ModuleList(blocks)
        step = blocks[0].outputs
        self.squeeze = nn.ModuleList(Pointwise(width + step * done, width, generator) for done in range(1, BLOCKS))
        self.outputs = width + step * BLOCKS

    def forward(self, points: Tensor) -> Tensor:
        """Points (3, b, n) of normalised patches to features (outputs, b, n)."""
        x = self.first(points)
        features = torch.cat([self.blocks[0](x), x])
        for squeeze, block in zip(self.squeeze, self.blocks[1:], strict=True):
            features = torch.cat([block(F.relu(squeeze(features))), features])
        return features
