"""A Fourier network as a field; its bands open during the training."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from ...learned.networks.fourier_network import FourierNetwork, window
from ...learned.training.batches import Batch
from ...learned.training.field import Field
from ...learned.training.schedules import late_decay
from ..losses.guidance import guided_loss
from ..losses.oriented import OrientedLoss


class FourierField(Field):
    """A Fourier network under Eq. 4.4; the learning rate falls over the last fifth (thesis, implementation details)."""

    def __init__(self, loss: OrientedLoss, bands: int = 8, progressive: float = 0.8, guided: float = 0.0, **form: Any):
        super().__init__()
        self.network, self._loss, self._progressive = FourierNetwork(bands, **form), loss, progressive
        self._guided = guided

    def forward(self, x: Tensor) -> Tensor:
        """The value at (n, 3) points."""
        return self.network(x)

    def loss(self, batch: Batch, t: float) -> Tensor:
        """Eq. 4.4. A training step sets the window; the validation uses the window of the extracted field."""
        if self._progressive and torch.is_grad_enabled():
            now = self.network.window
            now.copy_(now.new_tensor(window(t, len(now), self._progressive)))
        return guided_loss(self._loss, *self.network.value_and_gradient(batch.x), batch, t < self._guided)

    def rates(self, t: float) -> list[float]:
        """One group."""
        return [late_decay(t)]
