"""The network of ALIGNet in space: maps two occupancy volumes to a monotone grid."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ...learned.networks.point_encoder import draw_weights


class GridNetwork(nn.Module):
    """Convolutions over both volumes, a bottleneck, and the increments of a control grid (Hanocka et al. 2018).

    The released network is two-dimensional; this one has its order of layers, channels and bottleneck in space, and
    strides instead of its poolings. The last layer starts with weights 0 and equal increments: the identity.

    Parameters
    ----------
    cells : int
        Points of the grid along each axis.
    voxels : int, a multiple of 4
        Cells of a volume along each axis.
    channels : int
        Of the convolutions.
    narrow : int
        Channels of the bottleneck, from which the grid is made.
    generator : torch.Generator
        The weights are drawn from it, on the CPU.
    """

    def __init__(
        self, cells: int, voxels: int, channels: int = 20, narrow: int = 20, generator: torch.Generator | None = None
    ):
        super().__init__()
        self.cells, self.voxels = cells, voxels
        layers: list[nn.Module] = []
        for inputs, stride in ((2, 2), (channels, 2), (channels, 1)):
            layers += [nn.Conv3d(inputs, channels, 3, stride, padding=1), nn.ReLU()]
        self.convolutions = nn.Sequential(*layers)
        self.narrow = nn.Linear(channels * (voxels // 4) ** 3, narrow)
        self.last = nn.Linear(narrow, 3 * cells**3)
        draw_weights(self, generator)
        nn.init.zeros_(self.last.weight)
        nn.init.constant_(self.last.bias, spacing(cells))

    def encode(self, source: Tensor, target: Tensor) -> Tensor:
        """Point sets (b, n, 3) and (b, m, 3) in [-1, 1]^3 to the grids (b, 3, c, c, c) that take one to the other."""
        return monotone(self.increments(source, target))

    def increments(self, source: Tensor, target: Tensor) -> Tensor:
        """The distances (b, 3, c, c, c) between neighbours in those grids, before their absolute values are taken."""
        volumes = torch.stack([occupancy(source, self.voxels), occupancy(target, self.voxels)], dim=1)
        h = F.relu(self.narrow(self.convolutions(volumes).flatten(1)))
        return self.last(h).reshape(-1, 3, self.cells, self.cells, self.cells)

    def forward(self, points: Tensor, grid: Tensor) -> Tensor:
        """The new positions of points (b, n, 3) of the sources."""
        return warp(grid, points)


def spacing(cells: int) -> float:
    """The distance between neighbours of an even grid over [-1, 1]."""
    return 2 / (cells - 1)


def monotone(increments: Tensor) -> Tensor:
    """Positions of a grid: along each axis, the coordinate of that axis is a running sum of absolute increments.

    So a coordinate never decreases along its own axis, and a grid line never reverses. (Shears of two axes together may
    still invert a cell, as in the published grid.) If all increments are :func:`spacing`, this is the
    even grid over [-1, 1]^3.

    Parameters
    ----------
    increments : (b, 3, c, c, c) tensor
        Of the coordinates x, y and z; the last three axes are the grid's.

    Returns
    -------
    (b, 3, c, c, c) tensor
    """
    sums = [increments[:, axis].abs().cumsum(1 + axis) for axis in range(3)]
    return torch.stack(sums, dim=1) - 1 - spacing(increments.shape[2])


def warp(grid: Tensor, points: Tensor) -> Tensor:
    """Points moved by a grid, trilinear within its cells; beyond [-1, 1]^3 like the nearest point of it.

    Parameters
    ----------
    grid : (b, 3, c, c, c) tensor
        The new positions of the points of an even grid over [-1, 1]^3.
    points : (b, n, 3) tensor

    Returns
    -------
    (b, n, 3) tensor
    """
    inside = points.clamp(-1, 1)
    # grid_sample names the last axis first.
    moved = F.grid_sample(grid, inside.flip(2)[:, :, None, None], padding_mode="border", align_corners=True)
    return moved[:, :, :, 0, 0].transpose(1, 2) + (points - inside)


def occupancy(points: Tensor, voxels: int) -> Tensor:
    """Which cells of [-1, 1]^3 contain a point: (b, n, 3) to 0 and 1 in (b, voxels, voxels, voxels)."""
    cell = ((points + 1) * (voxels / 2)).long().clamp(0, voxels - 1)
    number = (cell[:, :, 0] * voxels + cell[:, :, 1]) * voxels + cell[:, :, 2]
    volume = points.new_zeros(len(points), voxels**3).scatter(1, number, 1.0)
    return volume.reshape(-1, voxels, voxels, voxels)
