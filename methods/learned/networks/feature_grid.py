"""Features on the vertices of grids, each twice as fine as the one before, interpolated between them."""

from __future__ import annotations

import itertools

import torch
from torch import Tensor, nn
from torch.nn import functional as F


class FeatureGrid(nn.Module):
    """Dense grids over the box [-1, 1]^3 with ``2^(base + i)`` cells along each side, i = 0 to levels - 1.

    A point outside has the features of the nearest point of the box. All grids are rows of one table, and the eight
    rows around a point are read and summed at once, so that the cost of a step depends on its points: sampling a
    volume as for convolutions reads and writes it whole.

    Parameters
    ----------
    levels, base : int
    width : int
        Features of a vertex.
    spread : float
        Standard deviation of the features at the beginning (released: 0.01).
    generator : torch.Generator
        On the CPU.
    sparse : bool
        The table's gradient holds only the rows of the batch.
    """

    sides: Tensor
    strides: Tensor
    corners: Tensor
    offsets: Tensor

    def __init__(
        self,
        levels: int,
        base: int = 2,
        *,
        width: int = 32,
        spread: float = 0.01,
        generator: torch.Generator | None = None,
        sparse: bool = False,
    ):
        super().__init__()
        self.sparse = sparse
        sides = [2 ** (base + i) for i in range(levels)]
        rows = [(side + 1) ** 3 for side in sides]
        self.table = nn.Parameter(torch.empty(sum(rows), width).normal_(0, spread, generator=generator))
        sides = torch.tensor(sides)
        n = sides + 1
        corners = torch.tensor(list(itertools.product((0, 1), repeat=3)))  # (8, 3)
        strides = torch.stack([n * n, n, torch.ones_like(n)], 1)  # (levels, 3): a vertex (i, j, k) is a row
        first = torch.tensor([0, *itertools.accumulate(rows)][:-1])
        self.register_buffer("sides", sides, persistent=False)
        self.register_buffer("strides", strides, persistent=False)
        self.register_buffer("corners", corners.bool(), persistent=False)
        # The row of each corner of a cell, counted from the row of the first corner of the grid's first cell.
        self.register_buffer("offsets", first[:, None] + strides @ corners.t(), persistent=False)  # (levels, 8)

    def forward(self, x: Tensor, levels: int | None = None) -> Tensor:
        """The sum of the features of the first ``levels`` grids: (n, 3) -> (n, width)."""
        rows, u = self._cells(x, levels)
        return self._sum(rows.flatten(1), self._weights(u).flatten(1))

    def features(self, x: Tensor) -> Tensor:
        """Those of each grid: (n, levels, width)."""
        rows, u = self._cells(x)
        return self._sum(rows.flatten(0, 1), self._weights(u).flatten(0, 1)).unflatten(0, rows.shape[:2])

    def features_and_slopes(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Those of each grid, and their derivatives by x, in the cell: (n, levels, width), (n, levels, 3, width)."""
        rows, u = self._cells(x)
        weights = torch.stack([self._weights(u), *(self._slopes(u, axis) for axis in range(3))], 2)
        rows = rows[:, :, None].expand_as(weights)
        found = self._sum(rows.flatten(0, 2), weights.flatten(0, 2)).unflatten(0, rows.shape[:3])
        inside = (x.abs() <= 1)[:, None, :, None]
        return found[:, :, 0], found[:, :, 1:] * inside

    def active(self, points: Tensor) -> int:
        """The number of vertices of cells that contain one of the (n, 3) points: the rows that a sparse grid stores."""
        stored = torch.zeros(len(self.table), dtype=torch.bool, device=points.device)
        for part in points.split(2**14):
            stored[self._cells(part)[0].flatten()] = True
        return int(stored.sum())

    def _cells(self, x: Tensor, levels: int | None = None) -> tuple[Tensor, Tensor]:
        """Rows of the corners (n, levels, 8), and the place of a point in its cell, 0 to 1: (n, levels, 3)."""
        sides = self.sides[:levels, None]
        u = (x.clamp(-1, 1) + 1)[:, None] * (0.5 * sides)
        cell = torch.minimum(u.long(), sides - 1)
        rows = (cell * self.strides[:levels]).sum(2, keepdim=True) + self.offsets[:levels]
        return rows, u - cell

    def _weights(self, u: Tensor, without: int | None = None) -> Tensor:
        """The weights of the eight corners: products of u or 1 - u over all axes, or all but one."""
        factors = torch.where(self.corners, u[..., None, :], 1 - u[..., None, :])
        return (
            factors.prod(-1) if without is None else factors[..., (without + 1) % 3] * factors[..., (without + 2) % 3]
        )

    def _slopes(self, u: Tensor, axis: int) -> Tensor:
        """Derivatives of the weights with respect to x along one axis."""
        sign = torch.where(self.corners[:, axis], 0.5, -0.5)
        return self._weights(u, axis) * sign * self.sides[: u.shape[1], None]

    def _sum(self, rows: Tensor, weights: Tensor) -> Tensor:
        return F.embedding_bag(rows, self.table, per_sample_weights=weights, mode="sum", sparse=self.sparse)
