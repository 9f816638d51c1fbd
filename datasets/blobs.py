"""Metaballs: smooth bodies of balls that merge, from compact clusters to strings with very thin necks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, spread
from .common.rotations import random_rotation
from .surfaces.balls import BallField
from .surfaces.implicit import Body, ImplicitSurface

WEIGHT = 5.0  # of each ball at its centre; a single one has the radius 0.64 of its reach
NECK = 1.12  # least sum of two neighbours on the line between them; at 1 they separate


@register("dataset", requires=("scipy", "skimage", "trimesh"))
@dataclass(frozen=True)
class Blobs(Family):
    """Metaballs (Wyvill's cubic kernels): smooth bodies; exact samples, normals and closest points.

    The surface is ``sum of 5 (1 - |x - c_i|^2 / R_i^2)^3 = 1``. Balls of different sizes are joined one by one to an
    existing ball, at a distance that grows with ``looseness``: 0 is a compact cluster, at 1 necks almost break. The
    looseness of the shapes is spread evenly between its limits (a golden-ratio sequence). Branches that meet again
    form handles, so the genus is not known before the mesh is made.
    """

    balls_low: int = 8  # fewest balls of a shape
    balls_high: int = 40  # most balls
    looseness_low: float = 0.15  # distance of joined balls: 1 is the farthest at which necks hold, 0 half of that
    looseness_high: float = 1.0  # equal limits give one looseness

    def __post_init__(self) -> None:
        if not 1 <= self.balls_low <= self.balls_high:
            raise ValueError(f"balls_low: expected 1 to balls_high={self.balls_high}, got {self.balls_low}")
        if self.balls_high > 200:
            raise ValueError(f"balls_high: expected at most 200, got {self.balls_high}")
        if not 0 <= self.looseness_low <= self.looseness_high <= 1:
            raise ValueError(
                "looseness_low: expected 0 <= looseness_low <= looseness_high <= 1, "
                f"got {self.looseness_low} and {self.looseness_high}"
            )

    def _shape(self, split: str, index: int) -> Shape:
        rng = generator("blobs", split, index)
        share = spread(index)
        looseness = self.looseness_low + (self.looseness_high - self.looseness_low) * share
        balls = int(rng.integers(self.balls_low, self.balls_high + 1))
        surface = ImplicitSurface(lambda: _body(generator("blobs", split, index, "balls"), balls, looseness))
        return Shape(
            f"blobs-{split}-{index:03d}",
            lambda: surface.mesh,
            surface=surface,
            info={"balls": balls, "looseness": looseness, "symmetry": "none"},
            exactness="implicit",
        )


def _body(rng: np.random.Generator, balls: int, looseness: float) -> Body:
    centres, reach = _joined_balls(rng, balls, looseness)
    field = BallField(np.einsum("ij,nj->ni", random_rotation(rng), centres), reach, np.full(balls, WEIGHT))
    low, high = field.box()
    # The thinnest necks are a few steps wide, and large bodies get at most a hundred thousand vertices.
    return Body(field, low, high, float(max(reach.min() / 9, np.linalg.norm(high - low) / 230)))


def _joined_balls(rng: np.random.Generator, balls: int, looseness: float) -> tuple[np.ndarray, np.ndarray]:
    """Centres (m, 3) and reaches (m,) of balls, each of which is joined to an earlier one."""
    reach = 0.45 * np.exp(rng.normal(scale=0.3, size=balls)).clip(0.55, 1.8)
    centres = np.zeros((balls, 3))
    for k in range(1, balls):
        # A loose string grows at its end, a cluster grows anywhere.
        parent = int(rng.integers(max(0, k - 3), k)) if rng.random() < 0.6 * looseness else int(rng.integers(k))
        distance = (0.5 + 0.5 * looseness) * _holding_distance(reach[parent], reach[k])
        candidates = rng.normal(size=(6, 3))
        candidates = centres[parent] + distance * candidates / np.linalg.norm(candidates, axis=1, keepdims=True)
        # Of several places, the one farthest from the other balls, so that balls do not pile up.
        room = ((candidates[:, None] - centres[:k]) ** 2).sum(axis=-1).min(axis=1)
        centres[k] = candidates[room.round(9).argmax()]  # rounded: often the parent is nearest, and all are equal
    return centres - centres.mean(axis=0), reach


def _holding_distance(one: float, other: float) -> float:
    """How far apart two balls may be so that their sum on the line between them stays above :data:`NECK`."""
    t = np.linspace(0, 1, 101)
    low, high = 0.0, one + other
    for _ in range(30):
        distance = (low + high) / 2
        falloff = np.maximum(1 - (t * distance / one) ** 2, 0) ** 3
        falloff += np.maximum(1 - ((1 - t) * distance / other) ** 2, 0) ** 3
        low, high = (distance, high) if WEIGHT * falloff.min() >= NECK else (low, distance)
    return low
