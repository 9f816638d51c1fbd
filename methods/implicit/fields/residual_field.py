"""The direct residual: the sum of two sine networks."""

from __future__ import annotations

import torch
from torch import Tensor

from ...learned.networks.sine_network import SineNetwork
from ..losses.oriented import OrientedLoss
from .displaced_field import attenuation, bound
from .supervised_field import SupervisedField


class ResidualField(SupervisedField):
    """f^(x) = N_B(x) + alpha chi(N_B(x)) N_D(x), with tanh of N_D if ``bounded``.

    As in :class:`~.displaced_field.DisplacedField`, the f inside chi is a constant in the training, and the gradient
    of f^ is that with constant chi. With ``nu = 0`` (the thesis's form) there is no chi.
    """

    def __init__(
        self,
        loss: OrientedLoss,
        base: SineNetwork,
        residual: SineNetwork,
        *,
        alpha: float = 1.0,
        nu: float = 0.0,
        bounded: bool = False,
    ):
        super().__init__(loss)
        self.base, self.residual = base, residual
        self.alpha, self.nu, self.bounded = alpha, nu, bounded

    def forward(self, x: Tensor) -> Tensor:
        """f^ at (n, 3) points."""
        f, d = self.base(x), self.residual(x)
        return f + self._strength(f) * (torch.tanh(d) if self.bounded else d)

    def value_and_gradient(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """f^ (n,) and its gradient (n, 3), with constant chi."""
        f, g = self.base.value_and_gradient(x)
        d, by_x = self.residual.value_and_gradient(x)
        if self.bounded:
            d, by_x = bound(d, by_x)
        strength = self._strength(f)
        return f + strength * d, g + strength[:, None] * by_x

    def _strength(self, f: Tensor) -> Tensor:
        return self.alpha * attenuation(f.detach(), self.nu)
