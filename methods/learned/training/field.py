"""The base of fitted fields: a scalar field with parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn

from .batches import Batch

if TYPE_CHECKING:
    from .settings import Training


class Field(nn.Module):
    """Base of all fields. ``t`` is the progress of the training, from 0 to 1.

    A subclass defines :meth:`forward`, the values at points, and :meth:`loss`, and overrides others as needed.
    """

    def loss(self, batch: Batch, t: float) -> Tensor:
        """The loss over ``batch``, divided by the points of the whole step."""
        raise NotImplementedError

    def groups(self) -> Sequence[list[nn.Parameter]]:
        """Parameters that share a learning rate."""
        return [list(self.parameters())]

    def rates(self, t: float) -> Sequence[float]:
        """The factor of the learning rate of each group; parameters whose factor is 0 do not change."""
        return [1.0]

    def optimizer(self, training: Training) -> torch.optim.Optimizer:
        """The optimizer; its groups are those of :meth:`groups`, and their rates are set before each step."""
        groups = [{"params": parameters, "lr": 0.0} for parameters in self.groups()]
        return torch.optim.Adam(groups, lr=training.learning_rate, betas=training.betas, fused=True)

    def count(self) -> int:
        """The number of parameters."""
        return sum(p.numel() for p in self.parameters())

    def count_active(self, points: Tensor) -> int | None:
        """The number that a sparse layout, if there is one, would store for a surface with ``points`` (n, 3)."""
        return None

    @torch.no_grad()
    def values(self, points: np.ndarray) -> np.ndarray:
        """The field at (n, 3) points, in the form that the mesher needs: float64 (n,)."""
        device = next(self.parameters()).device
        x = torch.as_tensor(np.asarray(points, dtype=np.float32), device=device)
        return torch.cat([self(part) for part in x.split(PART)]).double().cpu().numpy()


PART = 4096  # points that are evaluated at once: their features stay in the cache
