"""The training of the progressive network."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bench import Run

from ...learned.training.resumable import progress, step_generator, train
from ...learned.training.schedules import late_decay
from ..networks.levels import run_levels
from ..networks.unit import Units
from ..patches.progressive import patch_size
from .clouds import Clouds, Draw
from .loss import FIDELITY, chamfer
from .schedule import Moment, Stages, moment

VALIDATED = 12  # held-out patches of each input count
VALIDATIONS = 20  # in a training
TICKS = 1_000_000  # of a schedule by the clock


@dataclass(frozen=True)
class Plan:
    """The settings of the training; the fields are those of the method."""

    levels: int
    stages: Stages
    steps: int
    batch: int
    learning_rate: float
    decay: float
    inherit: bool
    patch: int
    share: float
    neighbours: int
    noise: float
    scale: float
    recut: bool


class Training:
    """Losses, schedule and validation of a network; random draws depend only on the seed and the number of a step.

    Parameters
    ----------
    network : Units
    examples : mapping
        Of :func:`.clouds.pack`.
    plan : Plan
    run : Run
    """

    def __init__(self, network: Units, examples: Mapping[str, np.ndarray], plan: Plan, run: Run):
        self.network, self.plan, self.run, self.seed = network, plan, run, run.seed
        self._now: Moment | None = None
        self._done = 0.0
        self._clouds = Clouds(examples, self._size, run.device)
        self._held_out = Clouds(examples, self._size, run.device, held_out=True)
        self.optimizer = torch.optim.Adam(network.parameters(), lr=plan.learning_rate, fused=run.device != "cpu")
        self._units = len(network)

    def weights(self) -> dict[str, np.ndarray]:
        """Train, and return the weights."""
        plan = self.plan
        return train(
            self.network,
            self.loss,
            self.run,
            steps=plan.steps,
            optimizer=self.optimizer,
            prepare=self.prepare,
            validate=self.validate,
            every=max(50, (plan.steps or 2000) // VALIDATIONS),
            clip_value=1.0,
        )

    def prepare(self, step: int) -> None:
        """Freeze, set the rate, and initialise a new level from the one before."""
        plan, network = self.plan, self.network
        self._done = done = max(self._done, progress(self.run, step, plan.steps))
        before, now = self._now, self.moment(step, done)
        # By the clock, the first step of a level may come after the beginning of its stage.
        opens = now.opens or (before is not None and before.level < now.level)
        self._now = now
        if opens and now.level > 1 and plan.inherit:
            trained = network[now.level - 2].state_dict()
            for level in range(now.level - 1, self._units):  # and all later ones: the training may end at any time
                network[level].load_state_dict(trained)
        for level in range(self._units):
            network[level].requires_grad_(now.first <= level + 1 <= now.level)
        rate = plan.learning_rate * now.rate * late_decay(done, final=plan.decay)
        for group in self.optimizer.param_groups:
            group["lr"] = rate

    def moment(self, step: int, done: float) -> Moment:
        """The stage at a step, at progress ``done``."""
        steps = self.plan.steps
        if not steps or done > step / steps:
            step, steps = int(done * (TICKS - 1)), TICKS
        return moment(step, steps, self._units, self.plan.stages)

    def loss(self, step: int) -> Tensor:
        """The loss of a batch: that of one level, the mean over its patches. :meth:`prepare` comes before it."""
        plan = self.plan
        rng = step_generator(self.seed, step)
        now = self._now
        assert now is not None
        level = now.draw(rng)
        draw = Draw(plan.noise, plan.scale)
        group = int(rng.integers(len(self._clouds.sizes)))
        single = self._units < plan.levels  # one unit for all densities: all are equally often the input
        base = int(rng.integers(plan.levels)) if single else 0
        apart = plan.stages == "apart"
        wanted = list(range(1, level + 1)) if apart else [level]
        points, *truths = self._clouds.batch(group, plan.batch, wanted, rng, draw, base)
        first = now.level - 1 if now.first == now.level else 0
        output, truth = run_levels(self.network, points, truths, level, rng, first, apart, plan.recut)
        outliers = level == 1 or (now.outliers and level >= now.first)
        return FIDELITY * (plan.levels - level + 1) * chamfer(output, truth, outliers).mean()

    @torch.no_grad()
    def validate(self) -> float:
        """Chamfer distances of held-out patches at the last level, relative to those of the inputs."""
        rng = step_generator(self.seed, 0, "validation")
        levels = self.plan.levels
        scores = []
        for group in range(len(self._held_out.sizes)):
            draw = Draw(self.plan.noise)
            points, dense = self._held_out.batch(group, VALIDATED, [levels], rng, draw)
            output, truth = run_levels(self.network, points, [dense], levels, rng, recut=self.plan.recut)
            scores.append(float(chamfer(output, truth).mean() / chamfer(points, dense).mean()))
        return float(np.mean(scores))

    def _size(self, points: int) -> int:
        return patch_size(points, self.plan.patch, self.plan.neighbours, self.plan.share)
