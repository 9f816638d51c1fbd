"""Fields that learn from true distances, or from oriented points if there are none."""

from __future__ import annotations

from torch import Tensor

from ...learned.training.batches import Batch
from ...learned.training.field import Field
from ...learned.training.schedules import late_decay
from ..losses.oriented import OrientedLoss, squared_error


class SupervisedField(Field):
    """Base of the fields of :class:`..fitting.supervised.Supervised`: the batches determine the loss.

    A subclass defines :meth:`forward`, the values at points, and :meth:`value_and_gradient`.
    """

    def __init__(self, loss: OrientedLoss):
        super().__init__()
        self._loss = loss

    def value_and_gradient(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """The value (n,) and its gradient (n, 3), differentiable by the parameters."""
        raise NotImplementedError

    def loss(self, batch: Batch, t: float) -> Tensor:
        """The squared error of distances, or Eq. 4.4."""
        if batch.distances is not None:
            return squared_error(self(batch.x), batch)
        return self._loss(*self.value_and_gradient(batch.x), batch)

    def rates(self, t: float) -> list[float]:
        """One group: all networks learn from the beginning."""
        return [late_decay(t)]
