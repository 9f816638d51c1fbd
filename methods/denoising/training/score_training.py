"""The training of the score: positions near noisy points, and their offsets to the surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from bench import Run

from ...learned.training.resumable import step_generator
from ..networks.nearby import nearest
from ..networks.score_network import ScoreNetwork, planes_of
from .clouds import Clouds, Patch
from .normalised import NormalisedTraining

VALIDATED = 48  # held-out patches
FLOOR = 0.03  # radii of a patch: a lower bound of its offsets, as the denominator of the relative loss
AROUND = 4  # noisy points near a point at which its score is learned, itself among them


@dataclass(frozen=True)
class Plan:
    """The settings of the training; the fields are those of the method."""

    points: int
    queries: int
    noise: tuple[float, float]
    steps: int
    batch: int
    learning_rate: float
    decay: float


class Batch(NamedTuple):
    """Patches in their own unit, the distance from the seed to the farthest point."""

    patches: Tensor
    """(b, n, 3) tensor, the seed at 0"""
    points: Tensor
    """(b, q) int64 tensor: points of the inner half of each patch"""
    places: Tensor
    """(b, q, AROUND, 3) tensor: relative to those points"""
    offsets: Tensor
    """(b, q, AROUND, 3) tensor: from the places to the surface"""


class Training(NormalisedTraining):
    """Loss and validation of a network; random draws depend only on the run's seed and the number of a step.

    Parameters
    ----------
    network : ScoreNetwork
    examples : mapping
        Of :func:`.clouds.clouds_of`.
    plan : Plan
    run : Run
    """

    network: ScoreNetwork

    def __init__(self, network: ScoreNetwork, examples: Mapping[str, np.ndarray], plan: Plan, run: Run):
        self.network, self.plan, self.run = network, plan, run
        self.clouds, self.held_out = Clouds(examples), Clouds(examples, held_out=True)
        self.optimizer = torch.optim.Adam(network.parameters(), lr=plan.learning_rate, fused=run.device != "cpu")

    def loss(self, step: int) -> Tensor:
        """The mean over patches of the squared errors of the score, relative to the squared offsets: 1 for no score."""
        return self._errors(self.batch(self.clouds, self.plan.batch, step_generator(self.run.seed, step))).mean()

    def error(self) -> float:
        """The same of held-out patches."""
        rng = step_generator(self.run.seed, 0, "validation")
        parts = [self._errors(self.batch(self.held_out, 8, rng)) for _ in range(VALIDATED // 8)]
        return float(torch.cat(parts).mean())

    def batch(self, clouds: Clouds, count: int, rng: np.random.Generator) -> Batch:
        """Patches of one size, and positions in them."""
        size = min(self.plan.points, min(clouds.counts))
        drawn = [self._places(clouds.patch(size, self.plan.noise, rng), rng) for _ in range(count)]
        return Batch(*(torch.stack(parts).to(self.run.device) for parts in zip(*drawn, strict=True)))

    def _places(self, patch: Patch, rng: np.random.Generator) -> tuple[Tensor, ...]:
        """Noisy points near points; half of them moved part of the way to the surface, as during denoising."""
        noisy = patch.noisy
        unit = noisy[-1].norm().clamp_min(1e-12)
        count = min(self.plan.queries, len(noisy) // 2)
        points = torch.from_numpy(rng.choice(len(noisy) // 2, count, replace=False))
        around = noisy[nearest(noisy[points][None], noisy[None], AROUND)[0]]
        way = torch.from_numpy(np.maximum(rng.uniform(-1, 1, (*around.shape[:2], 1)), 0).astype(np.float32))
        # The nearest surface point of a position does not change while it moves towards that point.
        whole = patch.nearest_surface(around.reshape(-1, 3)).reshape(around.shape) - around
        places, offsets = around + way * whole, (1 - way) * whole
        return noisy / unit, points, (places - noisy[points][:, None]) / unit, offsets / unit

    def _errors(self, batch: Batch) -> Tensor:
        known = torch.cat([self.network.encode(batch.patches), planes_of(batch.patches)], dim=2)
        known = known.gather(1, batch.points[:, :, None].expand(-1, -1, known.shape[2]))
        known = known[:, :, None].expand(-1, -1, batch.places.shape[2], -1).flatten(0, 2)
        scores = self.network(batch.places.reshape(-1, 3), known[:, :-6], known[:, -6:])
        wrong = (scores.reshape(batch.offsets.shape) - batch.offsets).square().sum(3).mean((1, 2))
        return wrong / (batch.offsets.square().sum(3).mean((1, 2)) + FLOOR**2)
