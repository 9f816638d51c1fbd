"""The training of the generator: near to the clean images, and such that a discriminator classifies them as real."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from bench import Run

from ...learned.training.resumable import progress, step_generator, train
from .crops import Batch, Crops
from .discriminator import Discriminator
from .generator import Generator

BETAS = (0.5, 0.999)  # of Adam
VALIDATED = 24  # crops
VALIDATIONS = 15  # in a training
GENERATOR = "generator."


@dataclass(frozen=True)
class Plan:
    """The settings of the training; the fields are those of the method."""

    adversarial: float
    steps: int
    batch: int
    crop: int
    learning_rate: float


class Both(nn.Module):
    """The two networks as one, so that one optimiser and one checkpoint serve both."""

    def __init__(self, generator: Generator, discriminator: Discriminator | None):
        super().__init__()
        self.generator, self.discriminator = generator, discriminator


class Training:
    """Loss and validation; random draws depend only on the run's seed and the number of a step.

    Parameters
    ----------
    generator : Generator
        On the device of the run.
    discriminator : Discriminator, optional
        Needed if ``plan.adversarial`` is not 0.
    examples : mapping
        Of :func:`.pairs.pairs_of`.
    plan : Plan
    run : Run
    """

    def __init__(
        self,
        generator: Generator,
        discriminator: Discriminator | None,
        examples: Mapping[str, np.ndarray],
        plan: Plan,
        run: Run,
    ):
        self.plan, self.run = plan, run
        both = Both(generator, discriminator).to(run.device)
        self.both: Both = both.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch omits it
        self.crops = Crops(examples, plan.crop, run.device)
        held_out = Crops(examples, plan.crop, run.device, held_out=True)
        self.validation = held_out.draw(VALIDATED, step_generator(run.seed, 0, "validation"))
        self.optimizer = torch.optim.Adam(self.both.parameters(), plan.learning_rate, BETAS)

    def weights(self) -> dict[str, np.ndarray]:
        """Train, and return the weights of the generator."""
        every = max(20, (self.plan.steps or 2000) // VALIDATIONS)
        state = train(
            self.both,
            self.loss,
            self.run,
            steps=self.plan.steps,
            optimizer=self.optimizer,
            prepare=self.prepare,
            validate=self.validate,
            every=every,
        )
        return {name[len(GENERATOR) :]: array for name, array in state.items() if name.startswith(GENERATOR)}

    def prepare(self, step: int) -> None:
        """Set the learning rate: it falls to zero over the second half, as published."""
        done = progress(self.run, step, self.plan.steps)
        for group in self.optimizer.param_groups:
            group["lr"] = self.plan.learning_rate * min(1.0, 2 * (1 - done))

    def loss(self, step: int) -> Tensor:
        """The mean absolute difference, plus ``adversarial`` times the adversarial loss, plus the discriminator's loss.

        One sum serves both networks: in the generator's part the discriminator's weights are constants, and in the
        discriminator's part the generated image is.
        """
        rng = step_generator(self.run.seed, step)
        batch = self.crops.draw(self.plan.batch, rng)
        dropout = torch.Generator(device=self.run.device).manual_seed(int(rng.integers(2**62)))
        self.both.generator.draw_dropout_from(dropout)
        made = self.both.generator(batch.noisy)
        loss = batch.error(made)
        if self.both.discriminator is None:
            return loss
        return loss + self._adversarial(batch, torch.where(batch.covered, made, 0.0))

    def _adversarial(self, batch: Batch, made: Tensor) -> Tensor:
        discriminator = self.both.discriminator
        assert discriminator is not None
        constant = {name: weight.detach() for name, weight in discriminator.named_parameters()}
        objection = _cross_entropy(torch.func.functional_call(discriminator, constant, (batch.noisy, made)), 1.0)
        of_real = _cross_entropy(discriminator(batch.noisy, batch.clean), 1.0)
        of_made = _cross_entropy(discriminator(batch.noisy, made.detach()), 0.0)
        return self.plan.adversarial * objection + (of_real + of_made) / 2

    @torch.no_grad()
    def validate(self) -> float:
        """The error on crops of held-out shapes, relative to that of the noisy images."""
        self.both.eval()
        made = torch.cat([self.both.generator(noisy) for noisy in self.validation.noisy.split(8)])
        self.both.train()
        return float(self.validation.error(made) / self.validation.error(self.validation.noisy).clamp_min(1e-9))


def _cross_entropy(logits: Tensor, real: float) -> Tensor:
    return F.binary_cross_entropy_with_logits(logits, torch.full_like(logits, real))
