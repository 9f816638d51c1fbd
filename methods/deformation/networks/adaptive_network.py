"""The network of cycle-consistent deformation: maps a pair of shapes to the matrices of layers that move points."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ...learned.networks.point_encoder import draw_weights
from .pointnet import BatchNorm, PointNet, dense, wide

HIDDEN = 6  # layers between the coordinates and the last one
FARTHEST = 2.0  # range of the last layer; the longest side of a shape is 2


class AdaptiveNetwork(nn.Module):
    """Two encoders, a predictor of matrices from their codes, and seven layers that use them (Groueix et al. 2019).

    8,436,117 parameters at width 1, those in use in the released code; then 24,972 numbers are predicted for a
    pair. Channels are normalised over the batch.

    Parameters
    ----------
    width : float
        Factor of all channels.
    residual : bool
        The last layer predicts the displacement of a point, and starts at 0; otherwise it predicts the new position.
    generator : torch.Generator
        The weights are drawn from it, on the CPU.
    """

    def __init__(
        self,
        width: float = 1.0,
        residual: bool = False,
        generator: torch.Generator | None = None,
    ):
        super().__init__()
        self.residual = residual
        hidden, code = wide(64, width), wide(512, width)
        sizes = (3, wide(64, width), wide(128, width), wide(1024, width))
        self.encoders = nn.ModuleList(
            nn.Sequential(PointNet(sizes, normalised=True, last=False), dense(sizes[-1], code, True)) for _ in range(2)
        )
        inputs, outputs = (3, *[hidden] * HIDDEN), (*[hidden] * HIDDEN, 3)
        layers = [_Adapted(i, o) for i, o in zip(inputs, outputs, strict=True)]
        self.layers = nn.ModuleList(layers)
        self.predicted = [layer.predicted for layer in layers]
        between = wide(256, width)
        self.predictor = nn.Sequential(
            dense(2 * code, code, True), dense(code, between, True), nn.Linear(between, sum(self.predicted))
        )
        draw_weights(self, generator)
        if residual:
            nn.init.zeros_(layers[-1].linear.weight)
            nn.init.zeros_(layers[-1].linear.bias)

    def encode(self, source: Tensor, target: Tensor) -> Tensor:
        """Point sets (b, n, 3) and (b, m, 3) to the numbers (b, k) that define the layers."""
        return self.matrices(self.encoders[0](source), self.encoders[1](target))

    def matrices(self, source: Tensor, target: Tensor) -> Tensor:
        """The same from the codes (b, c) of the two encoders."""
        return self.predictor(torch.cat([source, target], dim=1))

    def forward(self, points: Tensor, code: Tensor) -> Tensor:
        """The new positions of points (b, n, 3) of the sources."""
        h = points
        for layer, numbers in zip(self.layers, code.split(self.predicted, dim=1), strict=True):
            h = layer(h, numbers)
        moved = FARTHEST * torch.tanh(h)
        return points + moved if self.residual else moved


class _Adapted(nn.Module):
    """relu(N((x + b) (1 + W))) with predicted W and b, then a layer of its own, all on each point."""

    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        self.inputs, self.predicted = inputs, inputs * inputs + inputs
        self.before = nn.Sequential(BatchNorm(inputs), nn.ReLU())
        self.linear = nn.Linear(inputs, outputs)
        self.after = nn.Identity() if outputs == 3 else nn.Sequential(BatchNorm(outputs), nn.ReLU())

    def forward(self, x: Tensor, numbers: Tensor) -> Tensor:
        square = numbers[:, : self.inputs**2].reshape(-1, self.inputs, self.inputs)
        x = x + numbers[:, None, self.inputs**2 :]
        return self.after(F.linear(self.before(x + x @ square), self.linear.weight, self.linear.bias))
