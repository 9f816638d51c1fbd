"""What the trainings share: the loop, and a rate that falls at the end."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from bench import Run

from ...learned.training.resumable import progress, train
from ...learned.training.schedules import cosine

VALIDATIONS = 50  # in a training


class DecayingTraining:
    """Base of the trainings: a subclass sets the attributes, and has a loss and an error.

    The network has layers that depend on the batch while it is trained, and does not while it is validated.

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

    def error(self) -> float:
        """The error on held-out patches."""
        raise NotImplementedError

    @torch.no_grad()
    def validate(self) -> float:
        """The error of the network as it will be used."""
        self.network.eval()
        error = self.error()
        self.network.train()
        return error

    def weights(self) -> dict[str, np.ndarray]:
        """Train, and return the weights."""
        self.network.train()
        steps = self.plan.steps
        every = max(50, (steps or 2000) // VALIDATIONS)
        more = {"prepare": self.prepare, "validate": self.validate, "every": every, "clip_value": 1.0}
        return train(self.network, self.loss, self.run, steps=steps, optimizer=self.optimizer, **more)

    def prepare(self, step: int) -> None:
        """Set the learning rate: it falls along half a cosine over the last half."""
        done = progress(self.run, step, self.plan.steps)
        factor = cosine((done - 0.5) / 0.5, 1.0, self.plan.decay)
        for group in self.optimizer.param_groups:
            group["lr"] = self.plan.learning_rate * factor
