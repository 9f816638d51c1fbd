"""The schedule of units in training: one level after the other, each first alone, then with those before it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Stages = Literal["progressive", "apart", "at_once"]
TRUSTED = 0.6  # of the stage in which a level is alone: after this its outliers are ignored


@dataclass(frozen=True)
class Moment:
    """The settings at one step."""

    level: int
    """The highest level that is trained, from 1"""
    first: int
    """The lowest, from 1"""
    outliers: bool
    """Whether the outliers of the highest level count"""
    rate: float
    """Factor of the learning rate"""
    opens: bool = False
    """Whether this is the first step of ``level``"""

    def draw(self, rng: np.random.Generator) -> int:
        """The level whose output is scored: higher ones are more likely if several are trained."""
        if self.first == self.level:
            return self.level
        weights = np.arange(1, self.level + 1)
        return int(rng.choice(weights, p=weights / weights.sum()))


def moment(step: int, steps: int, levels: int, stages: Stages) -> Moment:
    """The stage of a step of a training (Wang et al. 2019, section 3.1; lengths and rates as in the released code).

    ``progressive`` has 2 L - 1 stages of equal length, the last twice as long: unit 1; unit 2 alone; units 1 and 2;
    unit 3 alone; ... The full rate is for units that are alone after the first, half of it for all other stages.
    ``apart`` trains each unit alone, for the same time each; ``at_once`` trains all from the start.
    """
    if stages == "at_once" or levels == 1:
        return Moment(levels, 1, step < TRUSTED * steps / levels, 0.5)
    if stages == "apart":
        level, begin, end = _part(step, steps, levels)
        return Moment(level + 1, level + 1, _untrusted(level + 1, step, begin, end), 1.0, step == begin)
    stage, begin, end = _part(step, steps, 2 * levels)
    stage = min(stage, 2 * levels - 2)
    level = (stage + 1) // 2 + 1
    alone = stage % 2 == 1
    outliers = _untrusted(level, step, begin, end) if alone else level == 1
    first = level if alone else 1
    return Moment(level, first, outliers, 1.0 if alone and level > 1 else 0.5, step == begin and (alone or level == 1))


def _part(step: int, steps: int, parts: int) -> tuple[int, int, int]:
    """The equal part that a step is in, the first step of it, and the first of the next."""
    bounds = [part * steps // parts for part in range(parts + 1)]
    part = max(i for i in range(parts) if bounds[i] <= step)
    return part, bounds[part], bounds[part + 1]


def _untrusted(level: int, step: int, begin: int, end: int) -> bool:
    return level == 1 or step < begin + TRUSTED * (end - begin)
