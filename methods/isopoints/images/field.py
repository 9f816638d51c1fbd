"""A sine network fitted to images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ...learned.networks.sine_network import SineNetwork
from ...learned.training.field import Field
from .appearance import Appearance
from .moving import Motion, moving
from .samples import Samples
from .scene import Scene

DOUBLINGS = 5  # of the steepness, over the training (IDR: at epochs 250 to 1,250 of 2,000)


@dataclass(frozen=True)
class Terms:
    """Weights and settings of the loss; the fields are parameters of the methods."""

    color: float  # of the difference of colours, summed over channels
    mask: float  # of the cross entropy of -steepness f against inside or outside, divided by the steepness
    eikonal: float  # of (|gradient| - 1)^2
    steepness: float  # it doubles five times
    motion: Motion
    most: float  # largest norm of the derivative by a surface point, before the mean


class ImageField(Field):
    """f with f = 0 where the images show the surface.

    Parameters
    ----------
    scene : Scene
    terms : Terms
    appearance : Appearance, optional
        Learned, if the lights are not known.
    """

    def __init__(self, scene: Scene, terms: Terms, appearance: Appearance | None, omega: float, **form: Any):
        super().__init__()
        self.network = SineNetwork(omega, **form)
        self.appearance = appearance
        self._scene, self._terms = scene, terms

    def forward(self, x: Tensor) -> Tensor:
        """The value at (n, 3) points."""
        return self.network(x)

    def groups(self) -> Sequence[list[nn.Parameter]]:
        """The network, and the appearance."""
        groups = [list(self.network.parameters())]
        return groups if self.appearance is None else [*groups, list(self.appearance.parameters())]

    def rates(self, t: float) -> list[float]:
        """The rates halve after a third and after two thirds of the training; that of colours is higher."""
        factor = 0.5 ** int(3 * min(t, 0.999))
        return [factor] if self.appearance is None else [factor, Appearance.FASTER * factor]

    def steepness(self, t: float) -> float:
        """The steepness of the cross entropy, at a progress of the training."""
        return self._terms.steepness * 2 ** min(DOUBLINGS, int(8 * t))

    def colors(self, views: Tensor, points: Tensor, normals: Tensor, directions: Tensor) -> Tensor:
        """The colours of a surface: (n, 3), 0..1."""
        if self.appearance is None:
            return self._scene.shaded(views, normals)
        return self.appearance(points, normals, directions)

    def loss(self, batch: Samples, t: float) -> Tensor:  # type: ignore[override]
        """Colours of the surface, inside or outside of the other points, and the gradient's length."""
        terms, surface = self._terms, batch.surface
        # a point has the same weight in each step, independent of their number
        share = 1 / max(1, batch.pixels)
        loss = torch.zeros((), device=batch.space.device)
        if len(surface):
            kept = (surface.gradients, surface.directions, terms.motion, terms.most * share)
            points = moving(self.network(surface.points), surface.points, *kept)
            _, gradients = self.network.value_and_gradient(points)
            normals = F.normalize(gradients, dim=1)
            colors = self.colors(surface.views, points, normals, surface.directions)
            loss = loss + terms.color * share * (colors - surface.colors).abs().sum()
            loss = loss + terms.eikonal * share * (gradients.norm(dim=1) - 1).square().sum()
        steep = self.steepness(t)
        for some, inside in ((batch.occupied, 1.0), (batch.free, 0.0)):
            if len(some):
                values = self.network(some.points)
                wanted = torch.full_like(values, inside)
                entropy = F.binary_cross_entropy_with_logits(-steep * values, wanted, some.weights, reduction="sum")
                loss = loss + terms.mask * share / steep * entropy
        if len(batch.space):
            _, gradients = self.network.value_and_gradient(batch.space)
            loss = loss + terms.eikonal * share * (gradients.norm(dim=1) - 1).square().sum()
        return loss
