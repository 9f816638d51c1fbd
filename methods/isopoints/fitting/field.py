"""A sine network under the losses of section 4.2.2 of the thesis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor
from torch.nn import functional as F

from ...learned.networks.sine_network import SineNetwork
from ...learned.training.field import Field
from .batch import RegularisedBatch

MANY = 8000  # number of iso-points of a step at which their weight is one half (released)


@dataclass(frozen=True)
class Weights:
    """Weights of the terms of the loss, each a mean over its points."""

    surface: float = 1000.0  # |f| on the cloud, and on iso-points (Eq. 4.13)
    normal: float = 100.0  # normals of the cloud, and of iso-points (Eq. 4.14)
    space: float = 50.0  # exp(-steepness |f|) in space
    eikonal: float = 100.0  # the gradient's length
    steepness: float = 100.0
    steepening: float = 0.0  # the steepness grows by this factor more until the end (released: 1)
    squared: bool = False  # the square of the gradient's length less 1, instead of its absolute value (released)
    hold: float = 1.0  # weight of the terms of the iso-points
    # iso-points count as much as the cloud, or by their number
    mixing: Literal["equal", "by_count"] = "equal"
    facing: float = 50.0  # in space, penalises gradients opposite to the nearest point's normal (released: 2)
    facing_until: float = 1.0  # until this share of the training is done (released: 1/30)


class RegularisedField(Field):
    """f with f = 0 on a cloud, as far as iso-points confirm it, and on the iso-points.

    The learning rate halves after a third and after two thirds of the training (released).
    """

    def __init__(self, weights: Weights, omega: float, **form: Any):
        super().__init__()
        self.network, self._weights = SineNetwork(omega, **form), weights

    def forward(self, x: Tensor) -> Tensor:
        """The value at (n, 3) points."""
        return self.network(x)

    def rates(self, t: float) -> list[float]:
        """One group."""
        return [0.5 ** int(3 * min(t, 0.999))]

    def loss(self, batch: RegularisedBatch, t: float) -> Tensor:  # type: ignore[override]
        """The sum of the weighted terms; a part of a step has its share of each mean."""
        weights = self._weights
        f, gradient = self.network.value_and_gradient(batch.x)
        on, end, last = batch.on, batch.on + batch.iso, len(batch.x) - len(batch.bounds)
        surface, iso, space, false = (max(1, count) for count in batch.counts)
        cosine = F.cosine_similarity(gradient[:on], batch.normals)
        data = weights.surface * (batch.weights * f[:on].abs()).sum() / surface
        data = data + weights.normal * (batch.weights * (1 - cosine)).sum() / surface
        length = torch.linalg.vector_norm(gradient, dim=1) - 1
        stretch = length.square() if weights.squared else length.abs()
        if weights.squared:  # released: the means over surface and space are added, half of the weight each
            eikonal = (stretch[:on].sum() / surface + stretch[end:last].sum() / space) / 2
        else:
            eikonal = (stretch[:on].sum() + stretch[end:last].sum()) / (surface + space)
        steepness = weights.steepness * (1 + weights.steepening * t)
        off = torch.exp(-steepness * f[end:last].abs()).sum() / space
        loss = weights.eikonal * eikonal + weights.space * off
        if weights.facing and t < weights.facing_until:
            unit = F.normalize(gradient[end:last], dim=1)
            loss = loss + weights.facing * F.relu(-(unit * batch.facing).sum(1)).sum() / space
        if not batch.counts[1]:
            return loss + data
        short = F.relu(batch.bounds.abs() - batch.bounds.sign() * f[last:])
        unsigned = F.cosine_similarity(gradient[on:end], batch.iso_normals).abs()
        regular = weights.surface * f[on:end].abs().sum() / iso + weights.normal * (1 - unsigned).sum() / iso
        if weights.mixing == "by_count":
            data = data * (surface / (surface + iso))
            regular = regular * (iso / (iso + MANY))
        regular = regular + weights.surface * short.sum() / false
        return loss + data + weights.hold * regular
