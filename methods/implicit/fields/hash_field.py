"""The field of a hash grid."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ...learned.networks.hash_grid import HashGrid
from ...learned.training.batches import Batch
from ...learned.training.field import Field
from ...learned.training.schedules import late_decay
from ..losses.guidance import guided_loss
from ..losses.oriented import OrientedLoss


class HashField(Field):
    """A sphere, and on top of it a network of the features of a hash grid.

        f = s(x) + W_2 h(W_1 phi(x) + b_1) + b_2,   s(x) = sqrt(|x|^2 + e^2) - sqrt(r^2 + e^2)

    with h = log(1 + exp(10 z)) / 10 (softplus), in one or several layers. Features start near 0, so f starts as the
    sphere, outside positive; e = 0.1 smooths the kink of |x| at the origin, where the surface may pass.

    Parameters
    ----------
    grid : HashGrid
    loss : OrientedLoss
    width, hidden_layers : int
    radius : float, of the sphere
    network_rate : float
        The learning rate of the network, relative to that of the features: it affects all points.
    guided : float
        Share of the training in which the distances of the batches, which are guesses, replace the term for the space.
    """

    SHARPNESS, ROUNDING = 10.0, 0.1

    def __init__(
        self,
        grid: HashGrid,
        loss: OrientedLoss,
        *,
        width: int = 64,
        hidden_layers: int = 1,
        radius: float = 0.5,
        network_rate: float = 0.3,
        guided: float = 0.0,
        generator: torch.Generator | None = None,
    ):
        super().__init__()
        self.grid, self._loss, self._network_rate, self._guided = grid, loss, network_rate, guided
        self._level_of_sphere = math.hypot(radius, self.ROUNDING)
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        sizes = [len(grid.table) * len(grid.cells), *[width] * hidden_layers, 1]
        for fan_in, fan_out in zip(sizes, sizes[1:], strict=False):
            bound = math.sqrt((1 if fan_out == 1 else 6) / fan_in)  # He's, for the layers with an h
            self.weights.append(nn.Parameter(torch.empty(fan_out, fan_in).uniform_(-bound, bound, generator=generator)))
            self.biases.append(nn.Parameter(torch.zeros(fan_out, 1)))
        # h(0) is not 0: the last bias subtracts it, otherwise the sphere would have another radius.
        with torch.no_grad():
            h = torch.zeros(sizes[0], 1)
            for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
                h = F.softplus(torch.addmm(bias, weight, h), self.SHARPNESS)
            self.biases[-1] -= self.weights[-1] @ h

    def forward(self, x: Tensor) -> Tensor:
        """The value at (n, 3) points."""
        h = self.grid(x)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            h = F.softplus(torch.addmm(bias, weight, h), self.SHARPNESS)
        return torch.addmm(self.biases[-1], self.weights[-1], h)[0] + self._sphere(x)[0]

    def value_and_gradient(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Value (n,) and gradient by x (n, 3); both differentiable by the parameters."""
        features, slopes = self.grid.with_derivatives(x)
        h, by_z = features, []
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            z = torch.addmm(bias, weight, h)
            h = F.softplus(z, self.SHARPNESS)
            by_z.append(torch.sigmoid(self.SHARPNESS * z))
        f = torch.addmm(self.biases[-1], self.weights[-1], h)[0]
        u = self.weights[-1].t()  # the derivative of f by the outputs of a layer
        for weight, slope in zip(self.weights[-2::-1], by_z[::-1], strict=True):
            u = weight.t() @ (u * slope)
        gradient = (slopes * u).sum(1).t()
        sphere, outward = self._sphere(x)
        return f + sphere, gradient + outward

    def _sphere(self, x: Tensor) -> tuple[Tensor, Tensor]:
        length = (x.square().sum(1) + self.ROUNDING**2).sqrt()
        return length - self._level_of_sphere, x / length[:, None]

    def loss(self, batch: Batch, t: float) -> Tensor:
        """Eq. 4.4; at first with guessed distances instead of its term for the space."""
        return guided_loss(self._loss, *self.value_and_gradient(batch.x), batch, t < self._guided)

    def groups(self) -> list[list[nn.Parameter]]:
        """The features, then the network."""
        return [[self.grid.table], [*self.weights, *self.biases]]

    def rates(self, t: float) -> list[float]:
        """Falling to a hundredth after the first third: the remaining error is then the noise of the steps."""
        factor = late_decay(t, begin=0.3, final=0.01)
        return [factor, self._network_rate * factor]
