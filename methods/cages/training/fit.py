"""The training of Neural Cages (thesis 5.1.1; Wang et al. 2020)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bench import Run

from ...learned.training.decaying import DecayingTraining
from ...learned.training.resumable import progress, step_generator
from ..coordinates.deforming import Coordinates, deformed
from ..losses.planes import neighbourhoods
from ..losses.terms import asymmetry, chamfer, laplacian_term, negative_weights, plane_terms
from ..networks.cage_network import CageNetwork
from .pairs import Pairs

VALIDATED = 24  # held-out pairs, at most
CLIPPED = 0.1  # largest entry of a gradient, as released
CAGE_RATE = 0.1  # of the learning rate, for the cage's own network


@dataclass(frozen=True)
class Plan:
    """The settings of the training; the fields are those of the method."""

    points: int
    neighbours: int
    batch: int
    stretch: float
    partners: bool
    mvc: float
    p2f: float
    normal: float
    symmetry: float
    laplacian: float
    warm_up: float
    steps: int
    learning_rate: float
    decay: float
    coordinates: Coordinates


class Training(DecayingTraining):
    """Each pair in three ways: source to target, target to source, and the source to itself.

    Parameters
    ----------
    network : CageNetwork
    faces : (f, 3) int array
        Of the cage.
    examples : mapping
        Of :func:`.pairs.pairs_of`.
    plan : Plan
    run : Run
    """

    begin_decay = 0.4
    clip_value = CLIPPED

    network: CageNetwork

    def __init__(
        self, network: CageNetwork, faces: np.ndarray, examples: Mapping[str, np.ndarray], plan: Plan, run: Run
    ):
        self.network, self.plan, self.run, self._faces = network, plan, run, faces
        self._train, self._held_out = Pairs(examples), Pairs(examples, held_out=True)
        slow = [*(network.caging.parameters() if network.caging is not None else ())]
        slow += [network.template] if isinstance(network.template, torch.nn.Parameter) else []
        known = {id(parameter) for parameter in slow}
        others = [parameter for parameter in network.parameters() if id(parameter) not in known]
        groups = [{"params": others, "share": 1.0}, {"params": slow, "share": CAGE_RATE}]
        self.optimizer = torch.optim.Adam([group for group in groups if group["params"]], plan.learning_rate)

    def prepare(self, step: int) -> None:
        """Set the learning rates; in the warm-up, encoder and cages do not change."""
        super().prepare(step)
        for group in self.optimizer.param_groups:
            group["lr"] *= group["share"]
        cold = progress(self.run, step, self.plan.steps) < self.plan.warm_up
        for parameter in (*self.network.encoder.parameters(), *self.optimizer.param_groups[-1]["params"]):
            if self.network.caging is not None or isinstance(self.network.template, torch.nn.Parameter):
                parameter.requires_grad_(not cold)

    def loss(self, step: int) -> Tensor:
        """Eq. 5.3 on a batch."""
        rng = step_generator(self.run.seed, step)
        numbers = rng.integers(len(self._train), size=self.plan.batch)
        drawn = [
            self._train.drawn(int(k), self.plan.points, self.plan.stretch, self.plan.partners, rng) for k in numbers
        ]
        ramp = 0.1 + 0.9 * progress(self.run, step, self.plan.steps)
        one, other = (self._tensor([pair[k] for pair in drawn]) for k in (0, 1))
        return self._loss(one, other, ramp)

    def validate(self) -> float:
        """The loss on the given held-out pairs, unstretched, with all terms in full."""
        rng = step_generator(self.run.seed, 0, "validation")
        count = min(len(self._held_out), VALIDATED)
        drawn = [self._held_out.drawn(k, self.plan.points, 0.0, False, rng) for k in range(count)]
        total = 0.0
        with torch.no_grad():
            for first in range(0, count, self.plan.batch):
                part = drawn[first : first + self.plan.batch]
                one, other = (self._tensor([pair[k] for pair in part]) for k in (0, 1))
                total += len(part) * float(self._loss(one, other, 1.0))
        return total / count

    def _tensor(self, clouds: list[np.ndarray]) -> Tensor:
        return torch.from_numpy(np.stack(clouds)).to(self.run.device)

    def _loss(self, one: Tensor, other: Tensor, ramp: float) -> Tensor:
        plan, size = self.plan, len(one)
        source, target = torch.cat([one, other, one]), torch.cat([other, one, one])
        cage, moved_cage = self.network(source, target)
        moved, weights = deformed(source, cage, self._faces, moved_cage, plan.coordinates, self.run.threads)
        paired = self._train.corresponding and not plan.partners
        aligned = slice(2 * size, None) if not paired else slice(None)
        loss = (moved[aligned] - target[aligned]).square().sum(dim=2).mean()
        if not paired:
            loss = loss + chamfer(moved[: 2 * size], target[: 2 * size])
        loss = loss + plan.mvc * negative_weights(weights)
        if plan.symmetry:
            loss = loss + plan.symmetry * (asymmetry(moved[: 2 * size]) + asymmetry(cage))
        if plan.p2f or plan.normal or plan.laplacian:
            near = neighbourhoods(torch.cat([one, other]), plan.neighbours)
            before, after = source[: 2 * size], moved[: 2 * size]
            if plan.p2f or plan.normal:
                flat, straight = plane_terms(before, after, near)
                loss = loss + ramp * (plan.p2f * flat + plan.normal * straight)
            if plan.laplacian:
                loss = loss + ramp * plan.laplacian * laplacian_term(before, after, near)
        return loss
