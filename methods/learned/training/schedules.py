"""Learning rates and loss weights as functions of the progress t of a training, from 0 to 1."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

BASE_ALONE = 0.2  # T_m: until then only the base is trained
BASE_FROZEN = 0.5  # released: from then on only the displacement is trained


def cosine(s: float, start: float, end: float) -> float:
    """From ``start`` at s = 0 to ``end`` at s = 1 along half a cosine; constant outside."""
    s = min(1.0, max(0.0, s))
    return start + (end - start) * (1 - math.cos(math.pi * s)) / 2


def late_decay(t: float, begin: float = 0.8, final: float = 0.1) -> float:
    """1, then down to ``final`` over the last fifth: 1e-4 to 1e-5 in the thesis."""
    return cosine((t - begin) / (1 - begin), 1.0, final)


@dataclass(frozen=True)
class Stage:
    """Factors at one progress: of the two losses, and of the learning rates of the two networks."""

    base_loss: float
    loss: float
    base_rate: float
    rate: float


def stage(t: float, schedule: Literal["thesis", "released", "none"]) -> Stage:
    """The progressive scheme of IDF.

    ``thesis``: kappa L_f + (1 - kappa) L_f^, with kappa = (1 + cos(pi (t - T_m)/(1 - T_m)))/2 from T_m = 0.2 to the
    end, and the learning rates likewise; all rates fall to a tenth over the last fifth.
    ``released``: the same blend, but from 0.2 to 0.5; then the base is frozen, and the displacement's rate falls to a
    tenth over the second half.
    ``none``: both networks learn from L_f^ from the beginning, the ablation of table 4.2.
    """
    if schedule == "none":
        return Stage(0.0, 1.0, late_decay(t), late_decay(t))
    if schedule == "thesis":
        kappa = cosine((t - BASE_ALONE) / (1 - BASE_ALONE), 1.0, 0.0)
        return Stage(kappa, 1 - kappa, kappa * late_decay(t), (1 - kappa) * late_decay(t))
    kappa = cosine((t - BASE_ALONE) / (BASE_FROZEN - BASE_ALONE), 1.0, 0.0)
    fall = cosine((t - BASE_FROZEN) / (1 - BASE_FROZEN), 1.0, 0.1)
    return Stage(kappa, 1 - kappa, kappa, (1 - kappa) * fall)
