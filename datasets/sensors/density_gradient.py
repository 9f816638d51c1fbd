"""Samples that thin out along a direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import PointCloud, Shape, register
from bench.geometry.used import used_vertices

from .checks import expect, expect_choice, expect_count, expect_direction
from .spoiling import unit

PROFILES = ("linear", "exponential")


@register("sensor")
@dataclass(frozen=True)
class DensityGradient:
    """Independent points of the exact surface whose density falls along a direction, with the exact normals.

    With s from 0 to 1 along the extent of the shape in that direction, the density per area is proportional to
    ``1 - (1 - 1/ratio) s`` (linear) or ``ratio**-s`` (exponential). Rejection sampling: exact, for any surface.
    """

    count: int = 5000  # points, exactly
    ratio: float = 10.0  # the highest density divided by the lowest; 1 is uniform
    profile: Literal["linear", "exponential"] = "exponential"  # how the density falls from the highest to the lowest
    direction: tuple[float, ...] | None = None  # along which it falls, three numbers; null: a random one

    def __post_init__(self) -> None:
        expect_count("count", self.count)
        expect(1 <= self.ratio <= 1000, "ratio", "1 to 1000", self.ratio)
        expect_choice("profile", self.profile, PROFILES)
        expect_direction("direction", self.direction)

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """A cloud of exactly ``count`` points."""
        direction = unit(self.direction, rng)
        heights = used_vertices(shape.mesh) @ direction
        low, extent = heights.min(), max(float(np.ptp(heights)), 1e-300)
        points, normals, found = [], [], 0
        while found < self.count:
            # At worst, with all of the area at the sparse end, 1 of `ratio` candidates is accepted.
            drawn, normal = shape.surface.sample(2 * self.count + 100, rng)
            s = np.clip((drawn @ direction - low) / extent, 0, 1)
            accepted = rng.random(len(s)) < self._density(s)
            points.append(drawn[accepted])
            normals.append(normal[accepted])
            found += int(accepted.sum())
        return PointCloud(np.concatenate(points)[: self.count], np.concatenate(normals)[: self.count])

    def _density(self, s: np.ndarray) -> np.ndarray:
        """The density divided by the highest, at s in 0..1."""
        return self.ratio**-s if self.profile == "exponential" else 1 - (1 - 1 / self.ratio) * s
