"""Some of the views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import BadInput, Effect, Shape, Views, register

from .checks import expect_choice, expect_count
from .spoiling import seen_as

CHOICES = ("even", "random", "first")


@register("sensor", gives="views")
@dataclass(frozen=True)
class ViewFew(Effect[Views]):
    """Only some of the views are left, in their order.

    ``even`` spreads them: after the first view, the next one is always the one whose camera, seen from the origin, is
    farthest in direction from all chosen ones. ``random`` chooses at random, ``first`` takes the first ones.
    """

    count: int = 6  # number of views that are left
    choice: Literal["even", "random", "first"] = "even"  # which views are left

    def __post_init__(self) -> None:
        expect_count("count", self.count)
        expect_choice("choice", self.choice, CHOICES)

    def spoil(self, views: Views, shape: Shape, rng: np.random.Generator) -> Views:
        """The views that are left.

        Raises
        ------
        BadInput
            If there are fewer than ``count``, or none of the remaining ones sees the shape.
        """
        if len(views) < self.count:
            raise BadInput(f"sensor view_few: expected at least count={self.count} views, got {len(views)}")
        if self.choice == "first":
            chosen = np.arange(self.count)
        elif self.choice == "random":
            chosen = rng.permutation(len(views))[: self.count]
        else:
            chosen = _spread(views.centers, self.count)
        chosen = np.sort(chosen)
        return seen_as(views, **{name: array[chosen] for name, array in views.arrays().items()})


def _spread(centers: np.ndarray, count: int) -> np.ndarray:
    """Farthest points among the directions of ``centers`` (n, 3): ``count`` indices, the first one 0."""
    directions = centers / np.maximum(np.linalg.norm(centers, axis=1, keepdims=True), 1e-300)
    cosines = directions @ directions.T
    chosen = [0]
    nearest = cosines[0].copy()
    nearest[0] = np.inf
    for _ in range(1, count):
        chosen.append(int(np.argmin(nearest)))
        nearest = np.maximum(nearest, cosines[chosen[-1]])
        nearest[chosen] = np.inf
    return np.array(chosen)
