"""The implicit displacement field: a smooth base, displaced along its normals (Eq. 4.2 and 4.3)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ...learned.networks.sine_network import SineNetwork
from ...learned.training.batches import Batch
from ...learned.training.field import Field
from ...learned.training.schedules import stage
from ..losses.guidance import guided_loss
from ..losses.oriented import OrientedLoss

# If chi is below this, a point is not displaced: at alpha = 0.05 that is less than 5e-5.
NEGLIGIBLE = 1e-3
PROBE = 16  # every PROBE-th point is tested to estimate how many are near the base


def attenuation(f: Tensor, nu: float) -> Tensor:
    """chi = 1 / (1 + (f/nu)^4): 1 on the base surface, 1/2 at a distance of nu, and soon negligible.

    With nu = 0 it is 1 everywhere.
    """
    return 1 / (1 + (f / nu) ** 4) if nu else torch.ones_like(f)


def bound(d: Tensor, by_x: Tensor) -> tuple[Tensor, Tensor]:
    """tanh of a displacement (n,), and its gradient (n, 3)."""
    d = torch.tanh(d)
    return d, by_x * (1 - d**2)[:, None]


class DisplacedField(Field):
    """Eq. 4.3: f^(x) = N_B(x + d n), with d = alpha tanh(N_D(x)) chi(N_B(x)) and n the base's unit normal at x.

    As in the released code, n and the f inside chi are constants in the training: no loss reaches the base through
    them, and grad f^ is that of the *frozen-normal form*, grad N_B(x^) + (grad N_B(x^) . n) chi alpha grad tanh(N_D),
    without the second derivatives of the base. Finite differences of f^ differ from it; those with constant n and chi
    do not.

    The displacement network is evaluated only where chi is not negligible; elsewhere x^ = x, and f^ is the base's
    value, which chi needed. With a frozen base, points of the space have no gradient there and cost one evaluation.

    Parameters
    ----------
    base, displacement : SineNetwork
        A subclass with its own :meth:`detail` and :meth:`forward` may displace by another network.
    alpha : float
        Largest displacement.
    nu : float
        Distance to the base at which the displacement is halved; 0 for no attenuation.
    bounded : bool
        Whether tanh bounds the displacement; without it, d = alpha N_D(x) chi.
    schedule : "thesis", "released" or "none"
        See :func:`...learned.training.schedules.stage`.
    guided : float
        Share of the training in which both losses are guided (:mod:`..losses.guidance`).
    """

    def __init__(
        self,
        loss: OrientedLoss,
        base: SineNetwork,
        displacement: nn.Module,
        *,
        alpha: float,
        nu: float,
        bounded: bool = True,
        schedule: Any = "thesis",
        guided: float = 0.0,
        negligible: float = NEGLIGIBLE,
    ):
        super().__init__()
        self.base, self.displacement = base, displacement
        self._loss, self._schedule, self._guided = loss, schedule, guided
        self.alpha, self.nu, self.bounded, self.negligible = alpha, nu, bounded, negligible

    # -- training --------------------------------------------------------------------------------------------------

    def groups(self) -> list[list[nn.Parameter]]:
        """The base, then the displacement."""
        return [list(self.base.parameters()), list(self.displacement.parameters())]

    def rates(self, t: float) -> list[float]:
        """The factors of the schedule."""
        now = stage(t, self._schedule)
        return [now.base_rate, now.rate]

    def loss(self, batch: Batch, t: float) -> Tensor:
        """kappa L_f + (1 - kappa) L_f^."""
        now, guided = stage(t, self._schedule), t < self._guided
        if now.loss == 0:
            return now.base_loss * guided_loss(self._loss, *self.base.value_and_gradient(batch.x), batch, guided)
        if now.base_loss == now.base_rate == 0 and torch.is_grad_enabled() and not guided:
            return now.loss * self._loss_of_displacement(batch)
        f, gradient = self.base.value_and_gradient(batch.x)
        displaced = self._displaced(batch.x, f, gradient)
        loss = now.loss * guided_loss(self._loss, *displaced, batch, guided)
        if now.base_loss:
            loss = loss + now.base_loss * guided_loss(self._loss, f, gradient, batch, guided)
        return loss

    def _loss_of_displacement(self, batch: Batch) -> Tensor:
        """L_f^ under a frozen base, up to a constant: points that are not displaced are left out."""
        with torch.no_grad():
            near = self._may_move(self.base(batch.x[batch.on :]))
            near = torch.cat([near.new_ones(batch.on), near])
        part = Batch(batch.x[near], batch.on, batch.normals, None, batch.total)
        with torch.no_grad():
            f, gradient = self.base.value_and_gradient(part.x)
        return self._loss(*self._displaced(part.x, f, gradient), part)

    # -- the field -------------------------------------------------------------------------------------------------

    def value_and_gradient(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """f^ (n,) and its gradient (n, 3) in the frozen-normal form."""
        return self._displaced(x, *self.base.value_and_gradient(x))

    def detail(self, x: Tensor, f: Tensor, gradient: Tensor) -> tuple[Tensor, Tensor]:
        """The displacement before bounds, (n,), and its gradient (n, 3), given the base's value and gradient at x."""
        assert isinstance(self.displacement, SineNetwork)
        return self.displacement.value_and_gradient(x)

    def _displaced(self, x: Tensor, f: Tensor, gradient: Tensor) -> tuple[Tensor, Tensor]:
        """f^ and its gradient, given those of the base at x."""
        n = F.normalize(gradient.detach(), dim=1)
        chi = attenuation(f.detach(), self.nu)
        rows = torch.nonzero(chi >= self.negligible)[:, 0]
        everywhere = len(rows) == len(x)
        here = f, gradient
        if not everywhere:
            x, n, chi, here = x[rows], n[rows], chi[rows], (f[rows], gradient[rows])
        d, by_x = self.detail(x, *here)
        if self.bounded:
            d, by_x = bound(d, by_x)
        strength = self.alpha * chi
        f_hat, g = self.base.value_and_gradient(x + (strength * d)[:, None] * n)
        g_hat = g + ((g * n).sum(1) * strength)[:, None] * by_x
        if everywhere:
            return f_hat, g_hat
        return f.index_copy(0, rows, f_hat), gradient.index_copy(0, rows, g_hat)

    @torch.no_grad()
    def forward(self, x: Tensor) -> Tensor:
        """f^ at (n, 3) points, each network where it is needed."""
        if not self.nu or self._may_move(self.base(x[::PROBE])).float().mean() > 0.7:
            f, gradient = self.base.value_and_gradient(x)  # saves a pass over value and gradient separately
            rows = torch.nonzero(self._may_move(f))[:, 0]
            gradient = gradient[rows]
        else:
            f = self.base(x)
            rows = torch.nonzero(self._may_move(f))[:, 0]
            _, gradient = self.base.value_and_gradient(x[rows])
        if not len(rows):
            return f
        near = x[rows]
        d = self._displacement(near, f[rows])
        return f.index_copy(0, rows, self.base(near + d[:, None] * F.normalize(gradient, dim=1)))

    @torch.no_grad()
    def parts(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """The base's value f and the displacement d = chi alpha tanh(N_D) along its normal, each (n,)."""
        f = self.base(x)
        return f, self._displacement(x, f)

    def _displacement(self, x: Tensor, f: Tensor) -> Tensor:
        d = self.displacement(x)
        return self.alpha * (torch.tanh(d) if self.bounded else d) * attenuation(f, self.nu)

    def _may_move(self, f: Tensor) -> Tensor:
        """Whether points at which the base has the values f are displaced at all."""
        return attenuation(f, self.nu) >= self.negligible
