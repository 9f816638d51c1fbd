"""The common part of trainings of deforming networks: pairs in both directions, and of shapes with themselves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bench import Run

from ...learned.training.decaying import DecayingTraining
from ...learned.training.resumable import progress, step_generator
from .pairs import Pairs

VALIDATED = 24  # pairs, or triplets, of the held-out shapes
AT_ONCE = 8  # of them


class Batch(NamedTuple):
    """Points of shapes: those that move, those for the encoders, and those of the target; each (b, n, 3)."""

    source: Tensor
    target: Tensor
    own: int
    """how many of them, the last, are paired with themselves: there the points of source and target correspond"""
    seen: Tensor
    """of the targets; other points of the sources if these are paired with themselves"""


class PairTraining(DecayingTraining):
    """Base of the trainings: a subclass defines the terms of the loss.

    Parameters
    ----------
    network : Module with ``encode(source, target)`` and ``forward(points, code)``
    examples : mapping
        Of :func:`.pairs.pairs_of`.
    plan : the method
        Its fields are ``points``, ``batch``, ``scale``, ``strangers``, ``steps``, ``learning_rate``, ``decay``, and the
        weights of the terms.
    run : Run
    """

    shapes: ClassVar[int] = 2  # number of shapes that are drawn together

    def __init__(self, network: nn.Module, examples: Mapping[str, np.ndarray], plan: Any, run: Run):
        self.network, self.plan, self.run = network, plan, run
        self.pairs, self.held_out = Pairs(examples), Pairs(examples, held_out=True)
        self.optimizer = torch.optim.Adam(network.parameters(), lr=plan.learning_rate, fused=run.device != "cpu")

    def terms(self, shapes: Tensor, rng: np.random.Generator, done: float) -> Tensor:
        """The loss.

        Parameters
        ----------
        shapes : (count, :attr:`shapes`, n, 3) tensor
            Each n is twice the points that move: the second half is for the encoders of shapes paired with themselves.
        rng : numpy Generator
        done : float
            Progress of the training, from 0 to 1.
        """
        raise NotImplementedError

    def loss(self, step: int) -> Tensor:
        """The loss of a step."""
        rng = step_generator(self.run.seed, step)
        return self.terms(self._drawn(self.pairs, self.plan.batch, rng), rng, progress(self.run, step, self.plan.steps))

    @torch.no_grad()
    def validate(self) -> float:
        """The loss of held-out pairs, with the weights of the end of the training."""
        self.network.eval()
        rng, losses = step_generator(self.run.seed, 0, "validation"), []
        for _ in range(VALIDATED // AT_ONCE):
            losses.append(float(self.terms(self._drawn(self.held_out, AT_ONCE, rng), rng, 1.0)))
        self.network.train()
        return float(np.mean(losses))

    def _drawn(self, pairs: Pairs, count: int, rng: np.random.Generator) -> Tensor:
        plan = self.plan
        points = pairs.draw(count, 2 * plan.points, plan.scale, plan.strangers, rng, self.shapes)
        return torch.from_numpy(points).to(self.run.device)


def crossed(shapes: Tensor) -> Batch:
    """Both directions of each pair (count, 2, 2 n, 3), and the first shape to itself."""
    half = shapes.shape[2] // 2
    first, second = shapes[:, 0, :half], shapes[:, 1, :half]
    source, target = torch.cat([first, second, first]), torch.cat([second, first, first])
    return Batch(source, target, len(first), torch.cat([second, first, shapes[:, 0, half:]]))
