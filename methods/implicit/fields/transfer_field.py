"""The transferable displacement: it depends on a base only by descriptor and distance, so the base can be exchanged."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ...learned.networks.film import FilmNetwork, JoinedNetwork
from ...learned.networks.sine_network import SineNetwork
from ...learned.training.batches import Batch, Sampler
from ...learned.training.schedules import late_decay
from ..losses.oriented import OrientedLoss
from .descriptor import Cloud, Descriptor, Query
from .displaced_field import NEGLIGIBLE, DisplacedField, attenuation


class TransferField(DisplacedField):
    """Eq. 4.5: f^(x) = N_B(x + d n), with d = alpha chi(f) tanh(T(f-bar, phi(x))) and f = N_B(x).

    The gradient by x is that of the frozen-normal form, as in :class:`.displaced_field.DisplacedField`: n, chi and the
    normal in the condition are constant, phi and f-bar are not:

        grad T = (dT/dphi) grad phi + (dT/df-bar) (df-bar/df) grad f.

    It is computed by one backward pass through T, which keeps the graph, and by pulling dT/dphi back through the
    trilinear weights: a reverse pass for one number is cheaper than three forward tangents.

    Parameters
    ----------
    base : SineNetwork
        Never trained here.
    displacement : FilmNetwork or JoinedNetwork
        T.
    descriptor : Descriptor, or None for the base's normal instead of phi
    cloud : Cloud
        The points of the base for the descriptor.
    encoded : int
        Points of the cloud that it sees at once.
    normal : bool
        Whether the condition is phi and the base's normal, or only phi.
    scale : bool
        Whether T sees f-bar = tanh(f/nu), or f itself.
    every : int
        The descriptor runs, and learns, in one of this many steps; in the others its features are constants.
    noise : float
        Of positions and normals for the descriptor during training.
    generator : torch.Generator
        Of that noise, on the device of the training.
    """

    displacement: FilmNetwork | JoinedNetwork

    def __init__(
        self,
        loss: OrientedLoss,
        base: SineNetwork,
        displacement: FilmNetwork | JoinedNetwork,
        descriptor: Descriptor | None,
        cloud: Cloud,
        *,
        alpha: float,
        nu: float,
        encoded: int = 3000,
        normal: bool = True,
        scale: bool = True,
        every: int = 1,
        noise: float = 0.0,
        generator: torch.Generator | None = None,
        negligible: float = NEGLIGIBLE,
    ):
        super().__init__(loss, base, displacement, alpha=alpha, nu=nu, negligible=negligible)
        self.descriptor, self._cloud, self._generator = descriptor, cloud, generator
        self._encoded, self._with_normal, self._scales = encoded, normal, scale
        self._every, self._noise, self._steps = every, noise, 0
        self._features: Tensor | None = None
        self._constant: Tensor | None = None

    def onto(self, base: SineNetwork, cloud: Cloud) -> TransferField:
        """The same displacement on another base."""
        return TransferField(
            self._loss,
            base,
            self.displacement,
            self.descriptor,
            cloud,
            alpha=self.alpha,
            nu=self.nu,
            encoded=self._encoded,
            normal=self._with_normal,
            scale=self._scales,
            negligible=self.negligible,
        )

    # -- training --------------------------------------------------------------------------------------------------

    def groups(self) -> list[list[nn.Parameter]]:
        """All networks except the base."""
        base = {id(p) for p in self.base.parameters()}
        return [[p for p in self.parameters() if id(p) not in base]]

    def rates(self, t: float) -> list[float]:
        """The rate falls over the last fifth, like that of the other fields (the released code's does not)."""
        return [late_decay(t)]

    def loss(self, batch: Batch, t: float) -> Tensor:
        """L_f^ without points that are not displaced, whose loss is constant. One batch is one step: no chunks."""
        if self.descriptor is not None:
            self._features = self._learning() if torch.is_grad_enabled() else self.encode()
        loss = self._loss_of_displacement(batch)
        self._features = None  # values between two steps use the current descriptor
        return loss

    def _learning(self) -> Tensor:
        """Features of a part of the cloud, with noise, to train the descriptor; or the latest ones."""
        self._steps += 1
        if (self._steps - 1) % self._every and self._constant is not None:
            return self._constant
        assert self.descriptor is not None
        features = self.descriptor(self._cloud.some(self._encoded, self._noise, self._generator))
        self._constant = features.detach()
        return features

    @torch.no_grad()
    def encode(self) -> Tensor:
        """Features (side^3, channels) of the base, without noise."""
        assert self.descriptor is not None
        return self.descriptor(self._cloud.first(self._encoded))

    # -- the field -------------------------------------------------------------------------------------------------

    def detail(self, x: Tensor, f: Tensor, gradient: Tensor) -> tuple[Tensor, Tensor]:
        """T (n,) at x and its gradient (n, 3), given the base's value and gradient there."""
        learning = torch.is_grad_enabled()
        with torch.enable_grad():
            scaled = self._scaled(f.detach()).requires_grad_()
            phi, condition, query = self._condition(x, F.normalize(gradient.detach(), dim=1))
            value = self.displacement(condition, scaled)
            by_scaled, *by_phi = torch.autograd.grad(value.sum(), [scaled, *phi], create_graph=learning)
            slope = (1 - scaled.detach() ** 2) / self.nu if self._scales else 1.0
            by_x = (by_scaled * slope)[:, None] * gradient.detach()
            if query is not None:
                by_x = by_x + query.pull(by_phi[0])
        return (value, by_x) if learning else (value.detach(), by_x.detach())

    def _condition(self, x: Tensor, normal: Tensor) -> tuple[list[Tensor], Tensor, Query | None]:
        """phi(x), if there is a descriptor; the condition of T; and the query of phi."""
        if self.descriptor is None:
            return [], normal, None
        if self._features is None:
            self._features = self.encode()
        query = Query(self._features, self.descriptor.side, x)
        phi = query.values if query.values.requires_grad else query.values.requires_grad_(torch.is_grad_enabled())
        return [phi], torch.cat([phi, normal], dim=1) if self._with_normal else phi, query

    def _scaled(self, f: Tensor) -> Tensor:
        """f-bar: the thesis's tanh(f/nu); the released code has tanh(0.8 f/nu)."""
        return torch.tanh(f / self.nu) if self._scales else f.clone()

    @torch.no_grad()
    def parts(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """The base's value f and the displacement d = chi alpha tanh(T) along its normal, each (n,)."""
        f, gradient = self.base.value_and_gradient(x)
        return f, self._along(x, f, F.normalize(gradient, dim=1))

    @torch.no_grad()
    def forward(self, x: Tensor) -> Tensor:
        """f^ at (n, 3) points, each network where it is needed."""
        f = self.base(x)
        rows = torch.nonzero(self._may_move(f))[:, 0]
        if not len(rows):
            return f
        near = x[rows]
        f_near, gradient = self.base.value_and_gradient(near)
        normal = F.normalize(gradient, dim=1)
        d = self._along(near, f_near, normal)
        return f.index_copy(0, rows, self.base(near + d[:, None] * normal))

    def _along(self, x: Tensor, f: Tensor, normal: Tensor) -> Tensor:
        """The displacement along given normals."""
        _, condition, _ = self._condition(x, normal)
        value = self.displacement(condition, self._scaled(f))
        return self.alpha * torch.tanh(value) * attenuation(f, self.nu)


class NearSampler(Sampler):
    """Half of a batch on the surface, half of it near: a displacement vanishes far away from its base.

    Parameters
    ----------
    points, normals, batch, generator
        As of :class:`...learned.training.batches.Sampler`.
    spread : float
        Standard deviation of the distance from the surface (released: 0.1 in a box of side 1).
    """

    def __init__(
        self, points: np.ndarray, normals: np.ndarray, batch: int, generator: torch.Generator, *, spread: float
    ):
        super().__init__(points, normals, batch, generator)
        self._spread = spread

    def draw(self) -> Batch:
        """The next batch."""
        device, generator = self._generator.device, self._generator
        rows = torch.randint(len(self._points), (2, self._batch), generator=generator, device=device)
        offsets = torch.randn(self._batch, 3, generator=generator, device=device) * self._spread
        x = torch.cat([self._points[rows[0]], self._points[rows[1]] + offsets])
        return Batch(x, self._batch, self._normals[rows[0]], None, len(x))
