"""A sine network under the loss of HotSpot (Wang et al. 2025)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ...learned.networks.sine_network import SineNetwork
from ...learned.training.batches import Batch
from ...learned.training.field import Field
from ...learned.training.schedules import late_decay


class HeatField(Field):
    """The field, and its loss.

    Parameters
    ----------
    network : SineNetwork
    surface, eikonal, heat : float
        Weights of |f| on the points, of ||grad f| - 1| everywhere, and of the heat in space; each is summed over its
        points, and divided by the number of all points, as in Eq. 4.4. The first is also the weight of -f where f is
        negative beyond radius 1: no point of the surface is there, so that is outside.
    absorption : pair of float
        lambda at the beginning and at the end.
    """

    def __init__(
        self, network: SineNetwork, *, surface: float, eikonal: float, heat: float, absorption: tuple[float, float]
    ):
        super().__init__()
        self.network, self._absorption = network, absorption
        self._surface, self._eikonal, self._heat = surface, eikonal, heat

    def forward(self, x: Tensor) -> Tensor:
        """The value at (n, 3) points."""
        return self.network(x)

    def absorption(self, t: float) -> float:
        """lambda at progress t."""
        begin, end = self._absorption
        return begin * (end / begin) ** t

    def loss(self, batch: Batch, t: float) -> Tensor:
        """The terms, at progress t."""
        f, gradient = self.network.value_and_gradient(batch.x)
        on = batch.on
        loss = self._surface * f[:on].abs().sum()
        beyond = batch.x[on:].square().sum(1) > 1
        loss = loss + self._surface * (f[on:] * beyond).neg().relu().sum()
        loss = loss + self._eikonal * (torch.linalg.vector_norm(gradient, dim=1) - 1).abs().sum()
        loss = loss + self._heat * heat(f[on:], gradient[on:], self.absorption(t)).sum()
        return loss / batch.total

    def groups(self) -> list[list[nn.Parameter]]:
        """One group."""
        return [list(self.network.parameters())]

    def rates(self, t: float) -> list[float]:
        """Falling to a hundredth over the last third."""
        return [late_decay(t, begin=0.67, final=0.01)]


def heat(f: Tensor, gradient: Tensor, absorption: float) -> Tensor:
    """(|grad h|^2 + lambda^2 h^2) / (2 lambda^2) of h = exp(-lambda |f|), which is h^2 (|grad f|^2 + 1) / 2: (n,)."""
    return 0.5 * torch.exp(-2 * absorption * f.abs()) * (gradient.square().sum(1) + 1)
