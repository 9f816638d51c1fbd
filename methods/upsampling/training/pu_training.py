"""The training of PU-Net."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bench import Run

from ...learned.training.decaying import DecayingTraining
from ...learned.training.resumable import step_generator
from ..losses.matching import earth_mover
from ..losses.repulsion import repulsion
from ..networks.pu_network import PuNetwork
from .loss import chamfer
from .pairs import Augmentation, held_out

EARTH_MOVER = 100.0
WEIGHTS = 1e-5  # of half the sum of squares of all weights and biases except the last layer's
RADIUS, WIDTH = 0.07, 0.03  # of the repulsion, for 1,024 points in a patch
VALIDATED = 16  # held-out patches


@dataclass(frozen=True)
class Plan:
    """The settings of the training; the fields are those of the method."""

    points: int
    times: int
    repulsion: float
    subset: bool
    noise: float
    jitter: float
    scale: float
    shift: float
    steps: int
    batch: int
    learning_rate: float
    decay: float
    tolerance: float


class Training(DecayingTraining):
    """Loss and validation of a network; random draws depend only on the run's seed and the number of a step.

    Parameters
    ----------
    network : PuNetwork
    examples : mapping
        Pairs of :func:`.clouds.pack`.
    plan : Plan
    widening : float
        Factor of the published radii.
    run : Run
    """

    def __init__(self, network: PuNetwork, examples: Mapping[str, np.ndarray], plan: Plan, widening: float, run: Run):
        self.network, self.plan, self.run, self.seed, self.widening = network, plan, run, run.seed, widening
        self.pairs, self.held_out = held_out(examples, plan.points, run.device, plan.times)
        self.optimizer = adam(network, network.last, plan.learning_rate, run.device)

    def loss(self, step: int) -> Tensor:
        """100 EMD + repulsion of a batch; the weight decay is in the optimiser."""
        plan = self.plan
        how = Augmentation(plan.noise, plan.jitter, plan.scale, plan.shift, plan.subset)
        patches = self.pairs.draw(plan.batch, step_generator(self.seed, step), how)
        output = self.network(patches.inputs)
        # The released code divides by the scale of the augmentation, not by its square.
        distance = (earth_mover(output, patches.truths, plan.tolerance) / patches.scales).mean()
        if not plan.repulsion:
            return EARTH_MOVER * distance
        apart = repulsion(output, RADIUS * self.widening, WIDTH * self.widening)
        return EARTH_MOVER * distance + plan.repulsion * apart

    @torch.no_grad()
    def validate(self) -> float:
        """Chamfer distances of held-out patches, relative to those of the inputs."""
        how = Augmentation(self.plan.noise)
        patches = self.held_out.draw(VALIDATED, step_generator(self.seed, 0, "validation"), how)
        output = self.network(patches.inputs)
        return float((chamfer(output, patches.truths) / chamfer(patches.inputs, patches.truths)).mean())


def adam(network: torch.nn.Module, last: torch.nn.Module, rate: float, device: str) -> torch.optim.Adam:
    """Adam over a network, with the derivative of 1e-5 |w|^2 / 2 added to the gradients of all layers but the last."""
    spared = {id(parameter) for parameter in last.parameters()}
    others = [parameter for parameter in network.parameters() if id(parameter) not in spared]
    groups = [{"params": others, "weight_decay": WEIGHTS}, {"params": list(last.parameters()), "weight_decay": 0.0}]
    return torch.optim.Adam(groups, lr=rate, fused=device != "cpu")
