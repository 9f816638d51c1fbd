"""The settings of the training loop of a field."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Training:
    """The settings of a training."""

    steps: int  # at most
    seconds: float = math.inf  # of wall clock, at most
    learning_rate: float = 1e-4
    betas: tuple[float, float] = (0.1, 0.9)
    chunk: int = 2048  # points of one forward and backward pass
    clip: float = 0.0  # largest norm of the gradient; 0 for none
    checkpoints: int = 20  # how often the state is compared with the best one, over the whole training
    traces: int = 0  # how often an intermediate result is offered
    begin: float = 0.0  # progress at which a schedule begins: a loaded field is beyond its first stages
    # the final state: the one with the least loss on a batch that is drawn beforehand; or, if the batches depend on the
    # field, the last one, or the mean of the last ones, which fluctuates less
    keep: Literal["best", "last", "mean"] = "best"
