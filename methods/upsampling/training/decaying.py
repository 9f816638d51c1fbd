"""What the trainings of one network on patches share: the loop, and a rate that falls at the end."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from bench import Run

from ...learned.training.resumable import progress, train
from ...learned.training.schedules import late_decay

VALIDATIONS = 20  # in a training


class DecayingTraining:
    """Base of the trainings: a subclass sets the attributes, and has a loss and a validation.

    Attributes
    ----------
    network : Module
    plan : with ``steps``, ``learning_rate`` and ``decay`` of the method
    run : Run
    optimizer : Optimizer
    """

    network: nn.Module
    plan: Any
    run: Run
    optimizer: torch.optim.Optimizer

    def loss(self, step: int) -> Tensor:
        """The loss of a step."""
        raise NotImplementedError

    def validate(self) -> float:
        """The error on held-out patches."""
        raise NotImplementedError

    def weights(self) -> dict[str, np.ndarray]:
        """Train, and return the weights."""
        steps = self.plan.steps
        every = max(50, (steps or 2000) // VALIDATIONS)
        arguments = {"steps": steps, "optimizer": self.optimizer, "every": every}
        return train(self.network, self.loss, self.run, prepare=self.prepare, validate=self.validate, **arguments)

    def prepare(self, step: int) -> None:
        """Set the learning rate."""
        done = progress(self.run, step, self.plan.steps)
        for group in self.optimizer.param_groups:
            group["lr"] = self.plan.learning_rate * late_decay(done, final=self.plan.decay)
