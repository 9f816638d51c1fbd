"""A point encoder with local pooling, after Convolutional Occupancy Networks: a feature for each occupied cell."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F

BLOCKS = 5


class PointEncoder(nn.Module):
    """Maps the normals of points to features of the cells that contain the points.

    Five residual blocks act on each point separately; between two of them the largest features of the points in the
    same cell are concatenated to those of the point itself. The final feature of a cell is the mean over its points.

    Positions enter only through the cells: the result does not change when points move within their cells, nor with
    the order of the points; when all move by whole cells together, the features move along. A shift by a part of a cell
    regroups the points, and changes the result; a rotation changes the normals.

    Parameters
    ----------
    features : int
        Channels of the result; points have twice as many in between.
    generator : torch.Generator
        The weights are drawn from it, on the CPU.

    Notes
    -----
    6,960 parameters for 16 features, as in the released code: 3 -> 32, five blocks 32 -> 16, 16 -> 16.
    """

    def __init__(self, features: int = 16, generator: torch.Generator | None = None):
        super().__init__()
        self.first = nn.Linear(3, 2 * features)
        blocks = [_Block(2 * features, features) for _ in range(BLOCKS)]
        self.blocks = nn.ModuleList(blocks)
        self.last = nn.Linear(features, features)
        draw_weights(self, generator)
        for block in blocks:
            nn.init.zeros_(block.second.weight)

    def forward(self, normals: Tensor, cells: Tensor) -> tuple[Tensor, Tensor]:
        """Features of the occupied cells.

        Parameters
        ----------
        normals : (n, 3) tensor
        cells : (n,) int tensor
            The number of the cell of each point.

        Returns
        -------
        occupied : (m,) int tensor, ascending
        features : (m, features) tensor
        """
        occupied, place, count = torch.unique(cells, return_inverse=True, return_counts=True)
        h = self.blocks[0](self.first(normals))
        for block in self.blocks[1:]:
            largest = _pooled(h, place, len(occupied), "amax")
            largest = largest.gather(0, place[:, None].expand_as(h))  # with [...] its gradient is not deterministic
            h = block(torch.cat([h, largest], dim=1))
        return occupied, _pooled(self.last(h), place, len(occupied), "sum") / count[:, None]


class _Block(nn.Module):
    """A residual block: W_2 relu(W_1 relu(x)) + W_3 x; W_2 begins as 0."""

    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        self.first = nn.Linear(inputs, outputs)
        self.second = nn.Linear(outputs, outputs)
        self.shortcut = nn.Linear(inputs, outputs, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        return self.second(F.relu(self.first(F.relu(x)))) + self.shortcut(x)


def _pooled(h: Tensor, place: Tensor, groups: int, how: str) -> Tensor:
    """The largest features, or their sum, in each group: (groups, c) from (n, c)."""
    return h.new_zeros(groups, h.shape[1]).scatter_reduce(
        0, place[:, None].expand_as(h), h, how, include_self=how == "sum"
    )


@torch.no_grad()
def draw_weights(module: nn.Module, generator: torch.Generator | None) -> None:
    """Weights and biases of all linear and convolutional layers from U(+-1/sqrt(fan_in)), torch's own default."""
    for layer in module.modules():
        if isinstance(layer, nn.Linear | nn.Conv3d):
            bound = 1 / math.sqrt(layer.weight[0].numel())
            for parameter in layer.parameters():
                parameter.uniform_(-bound, bound, generator=generator)
