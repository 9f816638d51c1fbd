"""The training of Points2Surf: distances and sides of queries near noisy clouds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from bench import Run

from ...learned.training.decaying import DecayingTraining
from ...learned.training.resumable import step_generator
from ..networks.surface_network import SurfaceNetwork
from .surfaces import Batch, Surfaces

TOGETHER = 16  # queries of one cloud
VALIDATED = 40  # clouds of held-out shapes


@dataclass(frozen=True)
class Plan:
    """The settings of the training; the fields are those of the method."""

    points: int
    subsample: int
    near: bool
    counts: tuple[int, int]
    noise: tuple[float, float]
    steps: int
    batch: int
    learning_rate: float
    decay: float


class Training(DecayingTraining):
    """Loss and validation of a network; random draws depend only on the run's seed and the number of a step.

    Parameters
    ----------
    network : SurfaceNetwork
    examples : mapping
        Of :func:`.surfaces.surfaces_of`.
    plan : Plan
    run : Run
    """

    begin_decay: ClassVar[float] = 0.5
    clip_value: ClassVar[float | None] = 1.0

    def __init__(self, network: SurfaceNetwork, examples: Mapping[str, np.ndarray], plan: Plan, run: Run):
        self.network, self.plan, self.run = network, plan, run
        self.surfaces, self.held_out = Surfaces(examples), Surfaces(examples, held_out=True)
        self.optimizer = torch.optim.Adam(network.parameters(), lr=plan.learning_rate, fused=run.device != "cpu")

    def loss(self, step: int) -> Tensor:
        """The published loss, of the queries of several clouds."""
        rng = step_generator(self.run.seed, step)
        return self._error([self._queries(self.surfaces, rng) for _ in range(-(-self.plan.batch // TOGETHER))])

    @torch.no_grad()
    def validate(self) -> float:
        """The same on held-out shapes, with the network in evaluation mode."""
        rng = step_generator(self.run.seed, 0, "validation")
        self.network.eval()
        parts = [
            float(self._error([self._queries(self.held_out, rng) for _ in range(8)])) for _ in range(VALIDATED // 8)
        ]
        self.network.train()
        return float(np.mean(parts))

    def weights(self) -> dict[str, np.ndarray]:
        """Train, and return the weights."""
        self.network.train()
        return super().weights()

    def _queries(self, surfaces: Surfaces, rng: np.random.Generator) -> Batch:
        plan = self.plan
        count = min(TOGETHER, plan.batch)
        return surfaces.queries(count, plan.counts, plan.noise, plan.points, plan.subsample, plan.near, rng)

    def _error(self, batches: list[Batch]) -> Tensor:
        joined = (torch.from_numpy(np.concatenate(arrays)) for arrays in zip(*batches, strict=True))
        patches, wholes, truth = (tensor.to(self.run.device) for tensor in joined)
        distances, logits = self.network(patches, wholes)
        return surface_loss(distances, logits, truth)


def surface_loss(distances: Tensor, logits: Tensor, truth: Tensor) -> Tensor:
    """The mean squared error of tanh of distances (b,), and the cross entropy of sides; truth is negative inside."""
    sides = F.binary_cross_entropy_with_logits(logits, (truth < 0).to(logits.dtype))
    return (torch.tanh(distances) - torch.tanh(truth.abs())).square().mean() + sides
