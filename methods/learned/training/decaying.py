"""The common part of trainings of one network on patches: the loop, and a learning rate that falls at the end."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from bench import Run

from .resumable import progress, train
from .schedules import late_decay


class DecayingTraining:
    """Base of the trainings: a subclass sets the attributes, and defines a loss and a validation.

    Attributes
    ----------
    network : Module
    plan : with ``steps``, ``learning_rate`` and ``decay`` of the method
    run : Run
    optimizer : Optimizer
    """

    validations: ClassVar[int] = 20  # in a training
    begin_decay: ClassVar[float] = 0.8  # progress of the training at which the rate begins to fall
    clip_value: ClassVar[float | None] = None  # largest entry of a gradient

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
        every = max(50, (steps or 2000) // self.validations)
        arguments = {"steps": steps, "optimizer": self.optimizer, "every": every, "clip_value": self.clip_value}
        return train(self.network, self.loss, self.run, prepare=self.prepare, validate=self.validate, **arguments)

    def prepare(self, step: int) -> None:
        """Set the learning rate."""
        done = progress(self.run, step, self.plan.steps)
        for group in self.optimizer.param_groups:
            group["lr"] = self.plan.learning_rate * late_decay(done, self.begin_decay, self.plan.decay)
