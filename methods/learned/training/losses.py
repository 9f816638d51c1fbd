"""The losses of steps, seldom read back from a device: the processor waits for the GPU at every read."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

EVERY = 20  # steps, on a GPU


class Losses:
    """Whether all losses so far are finite, and the last one.

    On the CPU each loss is read at once. On a GPU they are read together, every 20 steps and whenever :meth:`read` is
    called: before a state is compared, stored or returned.

    Parameters
    ----------
    device : str
    diverged : function of a loss and the number of its step
        Makes the error for the first loss that is not finite.
    every : int, optional
        Steps between two readings; by default as described above.
    """

    def __init__(self, device: str, diverged: Callable[[float, int], Exception], every: int | None = None):
        self._diverged = diverged
        self._every = every or (1 if torch.device(device).type == "cpu" else EVERY)
        self._pending: list[tuple[int, Tensor]] = []
        self._last = math.nan

    def add(self, loss: Tensor, step: int) -> None:
        """Add the loss (a scalar) of a step."""
        self._pending.append((step, loss.detach()))
        if len(self._pending) >= self._every:
            self.read()

    def read(self) -> float:
        """The last loss, after a check of those not read yet."""
        if self._pending:
            steps, losses = zip(*self._pending, strict=True)
            self._pending = []
            values = torch.stack(losses).tolist()
            for step, value in zip(steps, values, strict=True):
                if not math.isfinite(value):
                    raise self._diverged(value, step)
            self._last = values[-1]
        return self._last
