"""Features of the points of a patch, and the score at positions near them."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .nearby import gather, nearest

GROWTH = 12  # channels that each layer of an edge convolution adds
CHANNELS = 24  # of the input of an edge convolution
CONVOLUTIONS = 4
FEATURES = CHANNELS + 3 * GROWTH  # of a point
BLOCKS = 4  # of the score
PLANE = 48  # points to which the plane at a point is fitted


class DenseEdgeConvolution(nn.Module):
    """Three densely connected layers on the edges to the nearest members in feature space, and their maximum.

    The input of the published layers is, on each edge, both ends and their difference (``relative``: only the
    difference). They are linear before the first activation, so the part of one end is computed once for each member,
    not for each edge: the same numbers in a quarter of the time.
    """

    def __init__(self, neighbours: int, relative: bool):
        super().__init__()
        self.neighbours, self.relative = neighbours, relative
        self.first = nn.Linear(CHANNELS if relative else 3 * CHANNELS, GROWTH)
        self.second = nn.Linear(GROWTH + CHANNELS, GROWTH)
        self.last = nn.Linear(2 * GROWTH + CHANNELS, GROWTH)

    def forward(self, x: Tensor) -> Tensor:
        """Members (b, n, 24) to (b, n, 60)."""
        index = nearest(x, x, self.neighbours + 1)
        if self.relative:
            other = own = self.first.weight
            own = -own
        else:
            own, other, difference = self.first.weight.chunk(3, dim=1)
            own, other = own - difference, other + difference
        one = F.relu(gather(F.linear(x, other), index) + F.linear(x, own, self.first.bias)[:, :, None])
        grown, kept = self.second.weight.split([GROWTH, CHANNELS], dim=1)
        two = F.relu(F.linear(one, grown) + F.linear(x, kept, self.second.bias)[:, :, None])
        second, grown, kept = self.last.weight.split([GROWTH, GROWTH, CHANNELS], dim=1)
        edges = F.linear(two, second) + F.linear(one, grown) + F.linear(x, kept, self.last.bias)[:, :, None]
        return torch.cat([*(y.max(2)[0] for y in (edges, two, one)), x], dim=2)


class Block(nn.Module):
    """A residual block of two layers, to which a layer on the condition is added."""

    def __init__(self, condition: int, width: int):
        super().__init__()
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(2))
        self.layers = nn.ModuleList(nn.Linear(width, width) for _ in range(2))
        self.condition = nn.Linear(condition, width)

    def forward(self, x: Tensor, condition: Tensor) -> Tensor:
        """Rows (m, width), with their conditions (m, c)."""
        y = self.layers[0](F.relu(self.norms[0](x)))
        return x + self.layers[1](F.relu(self.norms[1](y))) + self.condition(condition)


class ScoreNetwork(nn.Module):
    """The network of Luo and Hu 2021: 187,291 parameters, of which the features have 11,544.

    Channels are normalised point by point; the published network normalises them over the batch, so that it differs
    between a single noise and the mixture that it was trained on. The score is the offset to a local plane plus a
    learned part, and positions are relative to that plane: minutes of training are too short to find planes.

    Parameters
    ----------
    neighbours : int
        Of a point, along whose edges features are computed.
    width : int
        Channels of the score.
    generator : torch.Generator, optional
        The weights are drawn from it, on the CPU.
    """

    def __init__(self, neighbours: int = 32, width: int = 128, generator: torch.Generator | None = None):
        super().__init__()
        first = [nn.Linear(3, CHANNELS), *(nn.Linear(FEATURES, CHANNELS) for _ in range(CONVOLUTIONS - 1))]
        self.transforms = nn.ModuleList(first)
        self.convolutions = nn.ModuleList(DenseEdgeConvolution(neighbours, i == 0) for i in range(CONVOLUTIONS))
        condition = FEATURES + 3
        self.into = nn.Linear(condition, width)
        blocks = [Block(condition, width) for _ in range(BLOCKS)]
        self.blocks = nn.ModuleList(blocks)
        self.norm, self.out = nn.LayerNorm(width), nn.Linear(width, 3)
        draw(self, generator)
        with torch.no_grad():  # blocks start as the identity, as in the released code; the score starts at 0
            for layer in (*(block.layers[1] for block in blocks), self.out):
                assert isinstance(layer, nn.Linear)
                layer.weight.zero_()
                layer.bias.zero_()

    def encode(self, patches: Tensor) -> Tensor:
        """The features of the points of patches: (b, n, 3) to (b, n, 60)."""
        x = patches
        for number, (transform, convolution) in enumerate(zip(self.transforms, self.convolutions, strict=True)):
            x = transform(x)
            x = convolution(F.relu(x) if number else x)
        return x

    def forward(self, places: Tensor, features: Tensor, planes: Tensor) -> Tensor:
        """The score at positions: the offset to the surface.

        That is the offset to a plane plus the output of the network, which is 0 before the training.

        Parameters
        ----------
        places : (m, 3) tensor
            Each relative to a point.
        features : (m, 60) tensor
            Those of that point.
        planes : (m, 6) tensor
            At that point: see :func:`planes_of`.

        Returns
        -------
        (m, 3) tensor
        """
        centre, normal = planes.split(3, dim=1)
        places = places - centre
        condition = torch.cat([places, features], dim=1)
        x = self.into(condition)
        for block in self.blocks:
            x = block(x, condition)
        return self.out(F.relu(self.norm(x))) - (places * normal).sum(1, keepdim=True) * normal


@torch.no_grad()
def planes_of(patches: Tensor) -> Tensor:
    """Planes through the nearest points of each: (b, n, 3) to (b, n, 6), a position relative to it, and a normal."""
    offsets = gather(patches, nearest(patches, patches, PLANE)) - patches[:, :, None]
    centre = offsets.mean(2)
    offsets = offsets - centre[:, :, None]
    covariance = offsets.transpose(2, 3) @ offsets
    return torch.cat([centre, torch.linalg.eigh(covariance)[1][..., 0]], dim=2)


def draw(network: nn.Module, generator: torch.Generator | None) -> None:
    """Draw the weights of all layers: uniform within 1 / sqrt(inputs), as by torch's default."""
    with torch.no_grad():
        for module in network.modules():
            if isinstance(module, nn.Linear):
                bound = module.in_features**-0.5
                module.weight.uniform_(-bound, bound, generator=generator)
                if module.bias is not None:
                    module.bias.uniform_(-bound, bound, generator=generator)
