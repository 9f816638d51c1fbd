"""The multi-resolution hash grid (Mueller et al. 2022): features of points and their spatial derivatives, in torch.

Lattices of growing resolution hold feature vectors at their nodes; a point's features are interpolated in each of them,
trilinearly. If a lattice has more nodes than the table has rows, nodes share rows by a hash; training resolves the
collisions. Losses need the gradient of the field with respect to x, and its derivatives with respect to the features.
Interpolation and its derivative are linear in the features, so both are computed side by side, and one backward pass
serves both, without second derivatives.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

PRIMES = (1, 2_654_435_761, 805_459_861)  # of the hash, one for each axis, as published
START = 1e-4  # initial features are uniform in +- this


class HashGrid(nn.Module):
    """Features of points of the box [-1, 1]^3; a point beyond it has those of the nearest point of the box.

    Parameters
    ----------
    levels : int
    table : int
        The largest number of rows of a level; a power of two.
    coarsest, finest : int
        Cells of the first and the last level along an axis; those between grow geometrically.
    features : int
        Of a node.
    generator : torch.Generator
        The features are drawn from it, on the CPU.

    Attributes
    ----------
    cells : list of int, of each level
    rows : list of int, of each level: ``(cells + 1)^3`` if that fits into the table (then no two nodes share one)
    table : (features, sum of rows) parameter
    """

    _strides: Tensor
    _first: Tensor
    _cells: Tensor

    def __init__(
        self,
        levels: int,
        table: int,
        coarsest: int,
        finest: int,
        *,
        features: int = 2,
        generator: torch.Generator | None = None,
    ):
        super().__init__()
        if table < 1 or table & (table - 1):
            raise ValueError(f"table: expected a power of two, got {table}")
        growth = (finest / coarsest) ** (1 / max(1, levels - 1))
        self.cells = [int(coarsest * growth**level + 1e-6) for level in range(levels)]
        self.rows = [min((n + 1) ** 3, table) for n in self.cells]
        self.table = nn.Parameter(torch.empty(features, sum(self.rows)).uniform_(-START, START, generator=generator))
        # The row of a node: first + (x s_0 o y s_1 o z s_2), where o is + in a dense level; in a hashed one it is xor,
        # and the last bits count.
        self._dense = sum((n + 1) ** 3 <= table for n in self.cells)  # they come first
        dense = [(1, n + 1, (n + 1) ** 2) for n in self.cells[: self._dense]]
        strides = torch.tensor([*dense, *[PRIMES] * (levels - self._dense)])
        first = torch.tensor([sum(self.rows[:level]) for level in range(levels)])
        self._mask = table - 1
        self.register_buffer("_strides", strides.t()[:, :, None].contiguous(), persistent=False)
        self.register_buffer("_first", first[:, None], persistent=False)
        self.register_buffer("_cells", torch.tensor(self.cells)[:, None], persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """The features (features * levels, n) of points (n, 3); no gradients."""
        rows, w, _ = self._locate(x)
        E = _gather(self.table.detach(), rows)
        for axis in range(3):
            E = _mix(E, w[axis])
        return E.flatten(0, 1)

    def with_derivatives(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """The features (features * levels, n), and their derivatives by x (3, features * levels, n).

        Both can be differentiated once with respect to the table; x is constant. Derivatives may jump between cells.
        """
        rows, w, scale = self._locate(x.detach())
        values, derivatives = _Interpolate.apply(self.table, rows, w, scale)
        return values.flatten(0, 1), derivatives.flatten(1, 2)

    def _locate(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The rows of the corners (2, 2, 2, L, n), the places in the cells (3, L, n), and cells per unit (L, 1)."""
        scale = self._cells.to(x.dtype) / 2
        place = (x.clamp(-1, 1).t().contiguous()[:, None] + 1) * scale
        low = torch.minimum(place.floor(), (self._cells - 1).to(x.dtype))
        ends = low.long() * self._strides
        ends = torch.stack([ends, ends + self._strides], dim=1)  # (3, 2, L, n)
        rows = torch.empty((2, 2, 2, *low.shape[1:]), dtype=torch.long, device=x.device)
        d = self._dense
        x0, y0, z0 = _corners(ends[..., :d, :])
        torch.add(x0 + y0, z0, out=rows[..., :d, :])
        x1, y1, z1 = _corners(ends[..., d:, :] & self._mask)
        torch.bitwise_xor(x1 ^ y1, z1, out=rows[..., d:, :])
        rows += self._first
        return rows, place - low, scale


def _corners(ends: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    return ends[0][:, None, None], ends[1][None, :, None], ends[2][None, None, :]


def _gather(table: Tensor, rows: Tensor) -> Tensor:
    """The features at rows: (features, 2, 2, 2, L, n). One at a time: torch is fastest on contiguous numbers."""
    E = torch.empty(len(table), rows.numel(), dtype=table.dtype, device=table.device)
    for feature, out in zip(table, E, strict=True):
        torch.index_select(feature, 0, rows.view(-1), out=out)
    return E.view(len(table), *rows.shape)


def _mix(E: Tensor, w: Tensor) -> Tensor:
    """Interpolation along the first axis of corners: (features, 2, ...) -> (features, ...)."""
    return torch.lerp(E[:, 0], E[:, 1], w.expand_as(E[:, 0]))


class _Interpolate(torch.autograd.Function):
    """Values and derivatives; along one axis a value is (1 - w) E_0 + w E_1, its derivative (E_1 - E_0) scale."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, rows: Tensor, w: Tensor, scale: Tensor) -> tuple[Tensor, Tensor]:
        E = _gather(table, rows)
        E_x = E[:, 1] - E[:, 0]
        E = torch.addcmul(E[:, 0], E_x, w[0])
        E_x = _mix(E_x, w[1])
        E_y = E[:, 1] - E[:, 0]
        E = torch.addcmul(E[:, 0], E_y, w[1])
        E_z = E[:, 1] - E[:, 0]
        E = torch.addcmul(E[:, 0], E_z, w[2])
        derivatives = torch.stack([_mix(E_x, w[2]), _mix(E_y, w[2]), E_z]).mul_(scale)
        ctx.save_for_backward(rows, w, scale)
        ctx.shape = table.shape
        return E, derivatives

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, dE: Tensor, derivatives: Tensor) -> tuple[Tensor | None, ...]:
        rows, w, scale = ctx.saved_tensors
        dx, dy, dz = derivatives * scale
        # The same steps in reverse, each time into the two ends of an axis.
        dE = _spread(dE, w[2], dz)
        dE = _spread(dE, w[1], _spread(dy, w[2]))
        dE = _spread(dE, w[0], _spread(_spread(dx, w[2]), w[1]))
        table = torch.zeros(ctx.shape, dtype=dE.dtype, device=dE.device)
        for feature, part in zip(table, dE, strict=True):
            feature.scatter_add_(0, rows.view(-1), part.reshape(-1))
        return table, None, None, None


def _spread(dE: Tensor, w: Tensor, difference: Tensor | None = None) -> Tensor:
    """The transpose of :func:`_mix`, and of the difference of the ends: (features, ...) -> (features, 2, ...)."""
    ends = torch.empty((len(dE), 2, *dE.shape[1:]), dtype=dE.dtype, device=dE.device)
    torch.mul(dE, w, out=ends[:, 1])
    torch.sub(dE, ends[:, 1], out=ends[:, 0])
    if difference is not None:
        ends[:, 1] += difference
        ends[:, 0] -= difference
    return ends
