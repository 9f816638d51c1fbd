"""A grid of features with a decoder for each level of detail."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from operator import add
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ...learned.networks.feature_grid import FeatureGrid
from ...learned.training.batches import Batch
from ...learned.training.field import Field
from ...learned.training.schedules import late_decay
from ..losses.oriented import OrientedLoss, squared_error

if TYPE_CHECKING:
    from ...learned.training.settings import Training


class NglodField(Field):
    """f_l(x) = decoder_l(x, sum of the features of grids 1 to l): two linear layers with a ReLU between.

    Outside of the box of the grids, f_l is its value at the nearest point of the box plus the distance to it. The
    released code continues with the border's features, so that a surface that touches the border becomes a tube.

    The loss is summed over all levels of detail; :attr:`lod` is the level of the field's value.
    """

    def __init__(
        self,
        loss: OrientedLoss,
        levels: int,
        base: int,
        *,
        lod: int,
        features: int = 32,
        hidden: int = 128,
        generator: torch.Generator | None = None,
        sparse: bool = False,
    ):
        super().__init__()
        self.grid = FeatureGrid(levels, base, width=features, generator=generator, sparse=sparse)
        self.lod, self._loss = lod, loss
        inputs = 3 + features

        def uniform(fan_in: int, *shape: int) -> nn.Parameter:
            bound = 1 / math.sqrt(fan_in)  # a linear layer's default
            return nn.Parameter(torch.empty(levels, *shape).uniform_(-bound, bound, generator=generator))

        self.weight, self.bias = uniform(inputs, hidden, inputs), uniform(inputs, hidden)
        self.out_weight, self.out_bias = uniform(hidden, hidden), uniform(hidden)

    # -- training --------------------------------------------------------------------------------------------------

    def groups(self) -> list[list[nn.Parameter]]:
        """The grid, then the decoders."""
        return [[self.grid.table], [self.weight, self.bias, self.out_weight, self.out_bias]]

    def rates(self, t: float) -> list[float]:
        """The same for both."""
        return [late_decay(t)] * 2

    def optimizer(self, training: Training) -> Any:
        """Adam; for a sparse grid, a variant that updates only the rows of the batch.

        It differs from Adam for rows away from the points: they do not move and keep their momentum, while Adam lets
        them move on for some ten steps. So a rarely used vertex needs more steps; but a step at six levels takes two
        fifths of the time, and its cost does not grow with the grid.
        """
        if not self.grid.sparse:
            return super().optimizer(training)
        grid, decoders = self.groups()
        return Together(
            torch.optim.SparseAdam(grid, lr=training.learning_rate, betas=training.betas),
            torch.optim.Adam(decoders, lr=training.learning_rate, betas=training.betas, fused=True),
        )

    def loss(self, batch: Batch, t: float) -> Tensor:
        """The sum over all levels of detail, of squared errors or of Eq. 4.4."""
        if batch.distances is not None:
            return reduce(add, (squared_error(f, batch) for f in self.levels(batch.x)))
        return reduce(add, (self._loss(f, gradient, batch) for f, gradient in self.levels_and_gradients(batch.x)))

    # -- the field -------------------------------------------------------------------------------------------------

    def forward(self, x: Tensor) -> Tensor:
        """The value at (n, 3) points, at the level of detail :attr:`lod`."""
        x, beyond = _into_box(x)
        return self._decode(torch.cat([x, self.grid(x, self.lod)], 1), self.lod - 1)[0] + _length(beyond)

    def levels(self, x: Tensor) -> list[Tensor]:
        """The values at (n, 3) points at each level of detail, from the coarsest: (n,) each."""
        x, beyond = _into_box(x)
        distance, features = _length(beyond), self.grid.features(x).cumsum(1)
        return [self._decode(torch.cat([x, part], 1), i)[0] + distance for i, part in enumerate(features.unbind(1))]

    def levels_and_gradients(self, x: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Values and gradients by x at each level of detail: (n,) and (n, 3); differentiable by the parameters."""
        x, beyond = _into_box(x)
        distance, outwards, inside = _length(beyond), F.normalize(beyond, dim=1), beyond == 0
        features, slopes = (part.cumsum(1) for part in self.grid.features_and_slopes(x))
        found = []
        for i, (part, slope) in enumerate(zip(features.unbind(1), slopes.unbind(1), strict=True)):
            f, h = self._decode(torch.cat([x, part], 1), i)
            by_input = ((h > 0) * self.out_weight[i]) @ self.weight[i]
            gradient = by_input[:, :3] + (slope @ by_input[:, 3:, None])[:, :, 0]
            found.append((f + distance, gradient * inside + outwards))
        return found

    def _decode(self, inputs: Tensor, i: int) -> tuple[Tensor, Tensor]:
        h = torch.addmm(self.bias[i], inputs, self.weight[i].t()).relu()
        return torch.addmv(self.out_bias[i], h, self.out_weight[i]), h

    # -- cost ------------------------------------------------------------------------------------------------------

    def count_active(self, points: Tensor) -> int:
        """Parameters that a sparse grid would store: features of cells with surface ``points`` (n, 3), and decoders.

        This is how NGLOD's authors count (without their octree). If points are sparser than the finest cells, it
        is less than for the whole surface.
        """
        decoders = sum(p.numel() for p in self.groups()[1])
        return self.grid.active(points.to(self.grid.table)) * self.grid.table.shape[1] + decoders


def _into_box(x: Tensor) -> tuple[Tensor, Tensor]:
    """The nearest points of the box, and the vectors from there."""
    nearest = x.clamp(-1, 1)
    return nearest, x - nearest


def _length(vectors: Tensor) -> Tensor:
    return torch.linalg.vector_norm(vectors, dim=1)


class Together:
    """Several optimizers as one."""

    def __init__(self, *optimizers: torch.optim.Optimizer):
        self._optimizers = optimizers

    @property
    def param_groups(self) -> list[dict[str, Any]]:
        """The groups of all optimizers."""
        return [group for optimizer in self._optimizers for group in optimizer.param_groups]

    def zero_grad(self, set_to_none: bool = True) -> None:
        """Of all."""
        for optimizer in self._optimizers:
            optimizer.zero_grad(set_to_none)

    def step(self, closure: Callable[[], float] | None = None) -> None:
        """Of all."""
        for optimizer in self._optimizers:
            optimizer.step(closure)
