"""The network of PointCleanNet: maps a patch to the displacement of its central point."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .score_network import draw

NEAR = 0.4  # radii of a patch: the standard deviation of the weights of its points, for the plane


class Block(nn.Module):
    """Two normalised layers and a shortcut, which is a normalised layer too if the width changes.

    Parameters
    ----------
    inputs, outputs : int
    bare : bool
        Without the final activation, and with outputs that are not normalised but start at 0.
    """

    def __init__(self, inputs: int, outputs: int, bare: bool = False):
        super().__init__()
        self.bare = bare
        self.first, self.second = Normalised(inputs, outputs, bare), Normalised(outputs, outputs, bare)
        self.shortcut = Normalised(inputs, outputs, bare) if inputs != outputs else nn.Identity()
        if bare:
            nn.init.ones_(self.first.norm.weight)

    def forward(self, x: Tensor) -> Tensor:
        """Rows (m, inputs) to (m, outputs)."""
        x = self.second(F.relu(self.first(x))) + self.shortcut(x)
        return x if self.bare else F.relu(x)


class Normalised(nn.Module):
    """A layer whose channels are normalised, or, for outputs with a geometric meaning, only scaled and shifted."""

    def __init__(self, inputs: int, outputs: int, scaled: bool = False):
        super().__init__()
        self.layer = nn.Linear(inputs, outputs)
        self.norm = Scaled(outputs) if scaled else nn.LayerNorm(outputs)

    def forward(self, x: Tensor) -> Tensor:
        """Rows (m, inputs) to (m, outputs)."""
        return self.norm(self.layer(x))


class Scaled(nn.Module):
    """A factor and a shift for each channel, which start at 0."""

    def __init__(self, channels: int):
        super().__init__()
        self.weight, self.bias = nn.Parameter(torch.zeros(channels)), nn.Parameter(torch.zeros(channels))

    def forward(self, x: Tensor) -> Tensor:
        """Rows (m, channels), scaled and shifted."""
        return x * self.weight + self.bias


class Pooled(nn.Module):
    """Blocks on each point, and the maximum of each channel."""

    def __init__(self, widths: list[int]):
        super().__init__()
        pairs = zip(widths[:-1], widths[1:], strict=True)
        self.blocks = nn.Sequential(*(Block(a, b) for a, b in pairs))

    def forward(self, x: Tensor) -> Tensor:
        """Sets (b, n, c) to (b, d)."""
        return self.blocks(x.flatten(0, 1)).unflatten(0, x.shape[:2]).amax(1)


class CleaningNetwork(nn.Module):
    """The residual network of Rakotosaona et al. 2019: 27,948,248 parameters at full width.

    A point transform (a rotation, by a quaternion), a feature transform (a matrix), blocks, a maximum over the points,
    and blocks down to a displacement, which is rotated back. As released except for the activation at the end of the
    last blocks, which would make all outputs positive: the last blocks of both transforms and of the head have none.
    Channels are normalised point by point, and those of the last blocks only scaled; in the released code, all are
    normalised over the batch. The displacement is added to that onto the plane of the nearer points, which is the only
    displacement before the training.

    Parameters
    ----------
    width : float
        Factor of all widths except the outputs'.
    generator : torch.Generator, optional
        The weights are drawn from it, on the CPU.
    """

    def __init__(self, width: float = 1.0, generator: torch.Generator | None = None):
        super().__init__()
        narrow, middle, wide, half, quarter = (max(2, round(width * n)) for n in (64, 128, 1024, 512, 256))
        self.of_turn, self.turn = Pooled([3, narrow, middle, wide]), head(wide, half, quarter, 4)
        self.points = nn.Sequential(Block(3, narrow), Block(narrow, narrow))
        self.of_matrix = Pooled([narrow, narrow, middle, wide])
        self.matrix = head(wide, half, quarter, narrow**2)
        self.of_patch = Pooled([narrow, narrow, middle, wide])
        self.displacement = head(wide, half, quarter, 3)
        draw(self, generator)

    def forward(self, patches: Tensor) -> Tensor:
        """Displacements (b, 3) of the points at 0, of patches (b, n, 3) in their principal frames, of radius 1."""
        onto_plane = to_planes(patches)
        turn = rotations(self.turn(self.of_turn(patches)))
        x = patches @ turn
        x = self.points(x.flatten(0, 1)).unflatten(0, x.shape[:2])
        matrix = self.matrix(self.of_matrix(x)).unflatten(1, (x.shape[2], x.shape[2]))
        x = x + x @ matrix
        moved = self.displacement(self.of_patch(x))
        return onto_plane + (moved[:, None] @ turn.transpose(1, 2))[:, 0]

    def features(self) -> int:
        """The number of parameters before the head."""
        return sum(p.numel() for p in self.parameters()) - sum(p.numel() for p in self.displacement.parameters())


@torch.no_grad()
def to_planes(patches: Tensor) -> Tensor:
    """Displacements from 0 onto planes through the nearer points: (b, n, 3) to (b, 3). Rows at 0 are ignored."""
    weights = torch.exp(-0.5 * (patches / NEAR).square().sum(2, keepdim=True)) * (patches != 0).any(2, keepdim=True)
    weights = weights / weights.sum(1, keepdim=True).clamp_min(1e-12)
    centre = (weights * patches).sum(1)
    offsets = patches - centre[:, None]
    normal = torch.linalg.eigh((weights * offsets).transpose(1, 2) @ offsets)[1][..., 0]
    return (centre * normal).sum(1, keepdim=True) * normal


def head(wide: int, half: int, quarter: int, outputs: int) -> nn.Sequential:
    """Blocks from the pooled features down to a few numbers, which may be negative."""
    return nn.Sequential(Block(wide, half), Block(half, quarter), Block(quarter, outputs, bare=True))


def rotations(raw: Tensor) -> Tensor:
    """Rotations (b, 3, 3) from the output (b, 4) of a transform: the quaternion 1 plus that."""
    w, x, y, z = F.normalize(raw + raw.new_tensor([1.0, 0.0, 0.0, 0.0]), dim=1).unbind(1)
    rows = [
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], dim=1),
        torch.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], dim=1),
        torch.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], dim=1),
    ]
    return torch.stack(rows, dim=1)
