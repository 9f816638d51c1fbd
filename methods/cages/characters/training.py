"""The training of the network that poses a template's cage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bench import Run

from ...learned.training.decaying import DecayingTraining
from ...learned.training.resumable import step_generator
from ..coordinates.mean_value import mean_value_coordinates
from ..networks.cage_network import PoseNetwork
from .examples import Poses

VALIDATED = 256  # held-out poses, at most


@dataclass(frozen=True)
class Plan:
    """The settings of the training; the fields are those of the method."""

    points: int
    batch: int
    worst: float
    steps: int
    learning_rate: float
    decay: float


class PoseTraining(DecayingTraining):
    """Poses with correspondences: the mean squared distance of vertices, and the largest of each pose.

    The cage at rest is fixed, so the coordinates of the template's vertices are computed once.

    Parameters
    ----------
    network : PoseNetwork
    examples : mapping
        Of :func:`.examples.poses_of`.
    plan : Plan
    run : Run
    """

    begin_decay = 0.5

    def __init__(self, network: PoseNetwork, examples: Mapping[str, np.ndarray], plan: Plan, run: Run):
        self.network, self.plan, self.run = network, plan, run
        self._train, self._held_out = Poses(examples), Poses(examples, held_out=True)
        rest, cage = (torch.from_numpy(np.array(examples[name])).double()[None] for name in ("rest", "cage"))
        weights = mean_value_coordinates(rest, cage, examples["cage_faces"], run.threads)
        self._weights = weights[0].float().to(run.device)
        self.optimizer = torch.optim.Adam(network.parameters(), plan.learning_rate)

    def loss(self, step: int) -> Tensor:
        """The loss of a batch of poses."""
        rng = step_generator(self.run.seed, step)
        numbers = rng.integers(len(self._train), size=self.plan.batch)
        return self._loss(*self._train.drawn(numbers, self.plan.points, rng))

    def validate(self) -> float:
        """The same loss on held-out poses."""
        rng = step_generator(self.run.seed, 0, "validation")
        count, total = min(len(self._held_out), VALIDATED), 0.0
        with torch.no_grad():
            for first in range(0, count, self.plan.batch):
                numbers = np.arange(first, min(first + self.plan.batch, count))
                total += len(numbers) * float(self._loss(*self._held_out.drawn(numbers, self.plan.points, rng)))
        return total / count

    def _loss(self, target: np.ndarray, posed: np.ndarray) -> Tensor:
        clouds, wanted = (torch.from_numpy(part).to(self.run.device) for part in (target, posed))
        moved = self._weights @ self.network(clouds)
        squared = (moved - wanted).square().sum(dim=2)
        return squared.mean() + self.plan.worst * squared.amax(dim=1).mean()
