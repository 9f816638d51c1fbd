"""The network of Points2Surf: predicts distance and side from a patch and a subsample."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F


class SurfaceNetwork(nn.Module):
    """Two PointNet encoders, of the points near a query and of the whole cloud, and a decoder (Erler et al. 2020).

    At a width of 1024 it has the published layers: 6,167,814 parameters with ``turn`` and ``transforms``, 5,366,018
    with only the transforms. All widths are in proportion, but the first layers keep at least 16 and 32 channels.

    Parameters
    ----------
    width : int
        Channels of the pooled features.
    turn : bool
        Whether both inputs are rotated by a rotation that a network predicts from the patch.
    transforms : bool
        Whether each encoder multiplies its first features by a matrix predicted from all points.
    generator : torch.Generator, optional
        The weights are drawn from it, on the CPU.
    """

    def __init__(
        self, width: int = 1024, turn: bool = True, transforms: bool = True, generator: torch.Generator | None = None
    ):
        super().__init__()
        narrow, middle = max(16, width // 16), max(32, width // 8)
        half, quarter, eighth = width // 2, width // 4, max(8, width // 8)
        self.turn = Transform(3, 4, narrow, middle, width) if turn else None
        self.near, self.whole = (Encoder(narrow, middle, width, transforms) for _ in range(2))
        self.of_near, self.of_whole = Layer(width, half), Layer(width, half)
        self.decoder = nn.Sequential(Layer(2 * half, quarter), Layer(quarter, eighth), nn.Linear(eighth, 2))
        draw(self, generator)

    def forward(self, patches: Tensor, wholes: Tensor) -> tuple[Tensor, Tensor]:
        """Distances, and logits of being inside.

        Parameters
        ----------
        patches : (b, n, 3) tensor
            Points near each query, relative to it, in radii of the patch.
        wholes : (b, m, 3) tensor
            Points of the cloud, relative to the query, in radii of the cloud.

        Returns
        -------
        distances : (b,) tensor, at least 0, in radii of the patch
        logits : (b,) tensor, positive inside
        """
        if self.turn is not None:
            turn = rotations(self.turn(patches))
            patches, wholes = patches @ turn, wholes @ turn
        known = torch.cat([self.of_near(self.near(patches)), self.of_whole(self.whole(wholes))], dim=1)
        distance, logit = self.decoder(known).unbind(1)
        return distance.abs(), logit


class Layer(nn.Module):
    """A linear layer, normalised over the batch, and a ReLU; of rows (m, c), or of sets (b, n, c)."""

    def __init__(self, inputs: int, outputs: int, active: bool = True):
        super().__init__()
        self.linear, self.norm, self.active = nn.Linear(inputs, outputs), nn.BatchNorm1d(outputs), active

    def forward(self, x: Tensor) -> Tensor:
        """The same with ``outputs`` channels."""
        y = self.norm(self.linear(x.flatten(0, -2))).unflatten(0, x.shape[:-1])
        return F.relu(y) if self.active else y


class Transform(nn.Module):
    """A few numbers from a set of points, which start at 0: (b, n, inputs) to (b, outputs)."""

    def __init__(self, inputs: int, outputs: int, narrow: int, middle: int, width: int):
        super().__init__()
        self.points = nn.Sequential(Layer(inputs, narrow), Layer(narrow, middle), Layer(middle, width))
        self.numbers = nn.Sequential(Layer(width, width // 2), Layer(width // 2, width // 4))
        self.last = nn.Linear(width // 4, outputs)

    def forward(self, x: Tensor) -> Tensor:
        """The numbers of each set."""
        return self.last(self.numbers(self.points(x).amax(1)))


class Encoder(nn.Module):
    """A PointNet: layers on each point, and the maximum of each channel; (b, n, 3) to (b, width)."""

    def __init__(self, narrow: int, middle: int, width: int, transforms: bool):
        super().__init__()
        self.first = nn.Sequential(Layer(3, narrow), Layer(narrow, narrow))
        self.matrix = Transform(narrow, narrow**2, narrow, middle, width) if transforms else None
        self.second = nn.Sequential(Layer(narrow, narrow), Layer(narrow, middle), Layer(middle, width, active=False))

    def forward(self, x: Tensor) -> Tensor:
        """The features of each set."""
        x = self.first(x)
        if self.matrix is not None:
            x = x + x @ self.matrix(x).unflatten(1, (x.shape[2], x.shape[2]))
        return self.second(x).amax(1)


def rotations(raw: Tensor) -> Tensor:
    """Rotations (b, 3, 3) from numbers (b, 4): the quaternion 1 plus these."""
    w, x, y, z = F.normalize(raw + raw.new_tensor([1.0, 0.0, 0.0, 0.0]), dim=1).unbind(1)
    rows = [
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], dim=1),
        torch.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], dim=1),
        torch.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], dim=1),
    ]
    return torch.stack(rows, dim=1)


@torch.no_grad()
def draw(network: nn.Module, generator: torch.Generator | None) -> None:
    """Draw the weights of all layers, uniform within 1 / sqrt(inputs); the last of each transform is 0."""
    for module in network.modules():
        if isinstance(module, nn.Linear):
            bound = module.in_features**-0.5
            module.weight.uniform_(-bound, bound, generator=generator)
            module.bias.uniform_(-bound, bound, generator=generator)
    for module in network.modules():
        if isinstance(module, Transform):
            module.last.weight.zero_()
            module.last.bias.zero_()
