"""One side of the shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Effect, PointCloud, Shape, register

from .checks import expect, expect_direction
from .spoiling import kept, unit


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class HalfSpace(Effect):
    """Only the points on one side of a plane are left; the position of the plane follows from the share ``keep``."""

    keep: float = 0.5  # fraction of the points that is left, at least one point
    direction: tuple[float, ...] | None = None  # normal of the plane, towards the side that is left; null: random

    def __post_init__(self) -> None:
        expect(0 < self.keep <= 1, "keep", "more than 0 and at most 1", self.keep)
        expect_direction("direction", self.direction)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """The points that are farthest along the direction, in their order."""
        heights = cloud.points @ unit(self.direction, rng)
        number = max(1, round(self.keep * len(cloud)))
        farthest = np.argsort(-heights, kind="stable")[:number]
        return kept(cloud, np.sort(farthest), shape, "half_space")
