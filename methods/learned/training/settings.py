"""How a field is fitted: the settings of the training loop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Training:
    """How a field is fitted."""

    steps: int  # at most
    seconds: float = math.inf  # of wall clock, at most
    learning_rate: float = 1e-4
    betas: tuple[float, float] = (0.1, 0.9)
    chunk: int = 2048  # points that go forwards and backwards at once
    clip: float = 0.0  # largest norm of the gradient; 0 for none
    checkpoints: int = 20  # how often the state is compared with the best one, over the whole training
    traces: int = 0  # how often an intermediate result is offered
    begin: float = 0.0  # progress at which a schedule begins: a field that was loaded is beyond its first stages
    # the state that is left: the one with the least loss on a batch that is drawn beforehand; or, where what is drawn
    # depends on the field, the last one, or the mean of the last ones, which shakes less
    keep: Literal["best", "last", "mean"] = "best"
