"""The training of KeypointDeformer (Jakab et al. 2021)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bench import Run
from bench.geometry.farthest import farthest_points

from ...learned.training.decaying import DecayingTraining
from ...learned.training.resumable import progress, step_generator
from ..coordinates.mean_value import mean_value_coordinates
from ..losses.terms import asymmetry, chamfer
from ..networks.keypoint_network import KeypointNetwork
from .pairs import Pairs

VALIDATED = 24  # held-out pairs, at most
INFLUENCE_RATE = 10  # times the learning rate, for the canonical influence: it starts at 0 and must approach 1


@dataclass(frozen=True)
class Plan:
    """The settings of the training; the fields are those of the method."""

    points: int
    keypoints: int
    batch: int
    stretch: float
    partners: bool
    farthest: float
    offset: float
    symmetry: float
    warm_up: float
    steps: int
    learning_rate: float
    decay: float


class KeypointTraining(DecayingTraining):
    """Pairs in both directions: the keypoints of a pair deform each shape to the other.

    Cages at rest and points of a source have no derivative, so coordinates are computed without any.

    Parameters
    ----------
    network : KeypointNetwork
    examples : mapping
        Of :func:`.pairs.pairs_of`.
    plan : Plan
    run : Run
    """

    begin_decay = 0.5

    network: KeypointNetwork

    def __init__(self, network: KeypointNetwork, examples: Mapping[str, np.ndarray], plan: Plan, run: Run):
        self.network, self.plan, self.run = network, plan, run
        self._faces = network.faces.cpu().numpy()
        self._train, self._held_out = Pairs(examples), Pairs(examples, held_out=True)
        others = [parameter for name, parameter in network.named_parameters() if name != "influence"]
        groups = [{"params": others, "share": 1}, {"params": [network.influence], "share": INFLUENCE_RATE}]
        self.optimizer = torch.optim.Adam(groups, plan.learning_rate)

    def prepare(self, step: int) -> None:
        """Set the learning rates."""
        super().prepare(step)
        for group in self.optimizer.param_groups:
            group["lr"] *= group["share"]

    def loss(self, step: int) -> Tensor:
        """The loss of a batch; in the warm-up only of the positions of keypoints."""
        rng, plan = step_generator(self.run.seed, step), self.plan
        numbers = rng.integers(len(self._train), size=plan.batch)
        drawn = [self._train.drawn(int(k), plan.points, plan.stretch, plan.partners, rng) for k in numbers]
        return self._loss(drawn, progress(self.run, step, plan.steps) < plan.warm_up)

    def validate(self) -> float:
        """The loss on the given held-out pairs, unstretched."""
        rng = step_generator(self.run.seed, 0, "validation")
        count, total = min(len(self._held_out), VALIDATED), 0.0
        drawn = [self._held_out.drawn(k, self.plan.points, 0.0, False, rng) for k in range(count)]
        with torch.no_grad():
            for first in range(0, count, self.plan.batch):
                part = drawn[first : first + self.plan.batch]
                total += len(part) * float(self._loss(part, False))
        return total / count

    def _loss(self, drawn: list[tuple[np.ndarray, np.ndarray]], cold: bool) -> Tensor:
        plan = self.plan
        clouds = np.stack([pair[k] for k in (0, 1) for pair in drawn])
        source = self._tensor(clouds)
        keypoints = self.network.keypoints(source)
        # The first point of a cloud is arbitrary, and so are the farthest points that follow from it.
        spread = [cloud[farthest_points(cloud, plan.keypoints, taken=1)] for cloud in clouds]
        loss = plan.farthest * chamfer(keypoints, self._tensor(np.stack(spread)))
        if cold:
            return loss
        target, wanted = (tensor.roll(len(drawn), dims=0) for tensor in (source, keypoints))
        keyed = self.network.follow(source, keypoints, wanted)
        with torch.no_grad():
            weights = mean_value_coordinates(source, keyed.cage, self._faces, self.run.threads)
        moved = weights @ keyed.moved
        if self._train.corresponding and not plan.partners:
            loss = loss + (moved - target).square().sum(dim=2).mean()
        else:
            loss = loss + chamfer(moved, target)
        loss = loss + plan.offset * keyed.offset.square().sum(dim=(1, 2)).mean()
        if plan.symmetry:
            loss = loss + plan.symmetry * (asymmetry(moved) + asymmetry(keypoints))
        return loss

    def _tensor(self, clouds: np.ndarray) -> Tensor:
        return torch.from_numpy(clouds).float().to(self.run.device)
