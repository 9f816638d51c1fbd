"""One sine network as a field."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from .field import Field
from .losses import OrientedLoss
from .sampling import Batch
from .schedules import late_decay
from .sine_network import SineNetwork


class SineField(Field):
    """A sine network under Eq. 4.4; the learning rate falls over the last fifth (thesis, implementation details)."""

    def __init__(self, loss: OrientedLoss, omega: float, **form: Any):
        super().__init__()
        self.network, self._loss = SineNetwork(omega, **form), loss

    def forward(self, x: Tensor) -> Tensor:
        """The value at (n, 3) points."""
        return self.network(x)

    def loss(self, batch: Batch, t: float) -> Tensor:
        """Eq. 4.4."""
        return self._loss(*self.network.value_and_gradient(batch.x), batch)

    def rates(self, t: float) -> list[float]:
        """One group."""
        return [late_decay(t)]
