"""The common part of the trainings of the denoisers: layers that depend on the batch during training."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import torch

from ...learned.training.decaying import DecayingTraining


class NormalisedTraining(DecayingTraining):
    """A subclass defines :meth:`error` instead of :meth:`validate`: the network is validated in evaluation mode."""

    validations: ClassVar[int] = 50
    begin_decay: ClassVar[float] = 0.5
    clip_value: ClassVar[float | None] = 1.0

    def error(self) -> float:
        """The error on held-out patches."""
        raise NotImplementedError

    @torch.no_grad()
    def validate(self) -> float:
        """The error of the network in evaluation mode."""
        self.network.eval()
        error = self.error()
        self.network.train()
        return error

    def weights(self) -> dict[str, np.ndarray]:
        """Train, and return the weights."""
        self.network.train()
        return super().weights()
