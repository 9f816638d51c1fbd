"""One sine network as a field."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from ...learned.networks.sine_network import SineNetwork
from ...learned.training.batches import Batch
from ...learned.training.field import Field
from ...learned.training.schedules import late_decay
from ..losses.guidance import guided_loss
from ..losses.oriented import OrientedLoss


class SineField(Field):
    """A sine network under Eq. 4.4; the learning rate falls over the last fifth (thesis, implementation details)."""

    def __init__(self, loss: OrientedLoss, omega: float, guided: float = 0.0, **form: Any):
        super().__init__()
        self.network, self._loss, self._guided = SineNetwork(omega, **form), loss, guided

    def forward(self, x: Tensor) -> Tensor:
        """The value at (n, 3) points."""
        return self.network(x)

    def loss(self, batch: Batch, t: float) -> Tensor:
        """Eq. 4.4, guided at first if requested."""
        return guided_loss(self._loss, *self.network.value_and_gradient(batch.x), batch, t < self._guided)

    def rates(self, t: float) -> list[float]:
        """One group."""
        return [late_decay(t)]
