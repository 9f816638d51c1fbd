"""The global context descriptor phi(x) of a transferable displacement: the position of a point relative to a base."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ...learned.networks.point_encoder import PointEncoder
from ...learned.networks.unet import UNet


@dataclass(frozen=True, eq=False)
class Cloud:
    """Oriented points of a base in the box [-1, 1]^3: positions and unit normals, each (n, 3)."""

    points: Tensor
    normals: Tensor

    def some(self, count: int, noise: float, generator: torch.Generator | None) -> Cloud:
        """``count`` of them, drawn with replacement, with Gaussian noise on positions and normals."""
        device = self.points.device
        rows = torch.randint(len(self.points), (count,), generator=generator, device=device)
        offsets = torch.randn(2, count, 3, generator=generator, device=device) * noise
        return Cloud(self.points[rows] + offsets[0], F.normalize(self.normals[rows] + offsets[1], dim=1))

    def first(self, count: int) -> Cloud:
        """The first ``count`` of them."""
        return Cloud(self.points[:count], self.normals[:count])


# The coarsest level of smaller grids has one or two cells per side, and oneDNN 3.12 sums the gradients of its bfloat16
# weights over uninitialised memory: two equal calls differ.
LEAST_MIXED = 12


class Descriptor(nn.Module):
    """Point encoder, grid and U-Net: maps a cloud to features at the cell centres of a grid over [-1, 1]^3.

    Parameters
    ----------
    side : int, a multiple of 4
        Cells along each side.
    channels : int, a multiple of 8
    generator : torch.Generator
        The weights are drawn from it, on the CPU.
    mixed : bool
        Convolve in bfloat16 during training, if the processor or the GPU supports it; never otherwise, nor with
        fewer than :data:`LEAST_MIXED` cells along a side.
    """

    def __init__(
        self, side: int = 32, channels: int = 16, generator: torch.Generator | None = None, *, mixed: bool = True
    ):
        super().__init__()
        self.side, self.channels, self.mixed = side, channels, mixed
        self.encoder = PointEncoder(channels, generator)
        self.unet = UNet(channels, generator)

    def forward(self, cloud: Cloud) -> Tensor:
        """Features (side^3, channels) of all cells; the last axis of space runs fastest."""
        cells = cell_numbers(cloud.points, self.side)
        occupied, features = self.encoder(cloud.normals, cells)
        grid = features.new_zeros(self.side**3, self.channels).index_copy(0, occupied, features)
        grid = grid.t().reshape(1, self.channels, self.side, self.side, self.side)
        fast = self.mixed and self.side >= LEAST_MIXED and torch.is_grad_enabled() and multiplies_bfloat16(grid.device)
        with torch.autocast(grid.device.type, dtype=torch.bfloat16, enabled=fast):
            grid = self.unet(grid)
        return grid.to(features.dtype).reshape(self.channels, -1).t().contiguous()


def multiplies_bfloat16(device: torch.device) -> bool:
    """Whether the hardware has products of bfloat16 matrices."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    supported = getattr(torch.cpu, "_is_avx512_bf16_supported", None)  # not in older versions
    return bool(supported and supported())


def cell_numbers(points: Tensor, side: int) -> Tensor:
    """The cell (n,) of each point (n, 3) of the box; points outside of it belong to the nearest cell."""
    cells = ((points + 1) * (side / 2)).floor().long().clamp(0, side - 1)
    return (cells[:, 0] * side + cells[:, 1]) * side + cells[:, 2]


class Query:
    """Trilinear interpolation at points (n, 3), written by hand because its gradient by x is differentiated again.

    The feature of a cell is the value at the cell's centre. (The released code puts the first and the last cell's
    values on the faces of the box, half a cell away from where they were collected.) Beyond the outermost centres
    the value is constant, and the gradient across is 0.

    Attributes
    ----------
    values : (n, channels) tensor
    """

    def __init__(self, features: Tensor, side: int, x: Tensor):
        place = (x + 1) * (side / 2) - 0.5
        low = place.floor().clamp(0, side - 2)
        along = (place - low).clamp(0, 1)
        inside = ((place >= 0) & (place <= side - 1)).to(x.dtype) * (side / 2)
        low = low.long()
        # For each of the eight corners: the first or the second plane along each axis.
        corners = torch.tensor([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)], device=x.device)
        numbers = ((low[:, None, 0] + corners[:, 0]) * side + low[:, None, 1] + corners[:, 1]) * side
        numbers = numbers + low[:, None, 2] + corners[:, 2]
        weight = torch.stack([1 - along, along], dim=2)[:, torch.arange(3, device=x.device), corners]  # (n, 8, 3)
        slope = (2 * corners - 1).to(x.dtype) * inside[:, None]
        a, b, c = weight.unbind(2)
        self._slopes = torch.stack([b * c, a * c, a * b], dim=2) * slope  # of the weights, by x: (n, 8, 3)
        self._features = F.embedding(numbers, features)  # (n, 8, channels)
        self.values = torch.einsum("nk,nkc->nc", weight.prod(2), self._features)

    def pull(self, by_values: Tensor) -> Tensor:
        """The gradient (n, 3) by x, from the gradient (n, channels) by the values."""
        return torch.einsum("nk,nkd->nd", torch.einsum("nkc,nc->nk", self._features, by_values), self._slopes)
