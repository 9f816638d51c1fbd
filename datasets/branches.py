"""Trees, corals and vessels: branching tubes that merge smoothly, thick trunks and thin twigs."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, pi
from typing import Literal

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of, spread
from .common.rotations import random_rotation
from .details.branching import Skeleton, colonise, murray_radii, separate
from .surfaces.balls import BallField
from .surfaces.implicit import Body, ImplicitSurface

KINDS = ("tree", "vessel", "coral")
REACH = 2.0  # of a kernel, in radii of its branch
SPACING = 0.7  # of the kernels along a branch, in radii: the surface is then even to 0.2 % of the radius
SEGMENT = 0.06
THICKEST_TIP = 0.04


@register("dataset", requires=("scipy", "skimage", "trimesh"))
@dataclass(frozen=True)
class Branches(Family):
    """Branching tubes grown by space colonisation; exact samples, normals and closest points.

    In turn a tree with a crown, a vessel that fills a ball, and a flat coral. Radii follow Murray's law ``r^p = sum of
    r_i^p``, with p spread evenly between two limits (a golden-ratio sequence): a low p gives a thick trunk. The surface
    is a level set of compact kernels along the branches, which merge smoothly at forks; twigs that would touch another
    part are cut off. Genus 0.
    """

    kind: Literal["all", "tree", "vessel", "coral"] = "all"  # of plant
    tip: float = 0.02  # radius of the twigs; a shape is about 2 in size
    exponent_low: float = 1.9  # p of Murray's law for the thickest trunks
    exponent_high: float = 3.0  # and for the most even ones
    goals: int = 300  # points that the branches grow towards: more give finer branching

    def __post_init__(self) -> None:
        expect_kind("kind", self.kind, KINDS)
        if not 0.01 <= self.tip <= THICKEST_TIP:
            raise ValueError(f"tip: expected 0.01 to {THICKEST_TIP}, got {self.tip}")
        if not 1.5 <= self.exponent_low <= self.exponent_high <= 4:
            raise ValueError(
                "exponent_low: expected 1.5 <= exponent_low <= exponent_high <= 4, "
                f"got {self.exponent_low} and {self.exponent_high}"
            )
        if not 20 <= self.goals <= 1000:
            raise ValueError(f"goals: expected 20 to 1000, got {self.goals}")

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        exponent = self.exponent_low + (self.exponent_high - self.exponent_low) * spread(index)
        surface = ImplicitSurface(lambda: self._body(generator("branches", split, index), kind, exponent))
        return Shape(
            f"branches-{split}-{index:03d}-{kind}",
            lambda: surface.mesh,
            surface=surface,
            tags=(kind,),
            info={"kind": kind, "genus": 0, "exponent": exponent, "tip": self.tip, "symmetry": "none"},
            exactness="implicit",
        )

    def _body(self, rng: np.random.Generator, kind: str, exponent: float) -> Body:
        trunk, goals = _room(rng, kind, self.goals)
        points, parent = colonise(goals, trunk, SEGMENT, 2.2 * SEGMENT)
        skeleton = separate(Skeleton(points, parent, murray_radii(parent, self.tip, exponent)), 1.6)
        centres, radius, weights = _strung(skeleton)
        # A straight branch of even radius r has its surface at r: the sum becomes an integral in closed form.
        integral = 32 / 35 * (1 - 1 / REACH**2) ** 3.5 * REACH
        field = BallField(np.einsum("ij,nj->ni", random_rotation(rng), centres), REACH * radius, weights / integral)
        return Body(field, *field.box(), self.tip * 0.62)


def _room(rng: np.random.Generator, kind: str, goals: int) -> tuple[np.ndarray, np.ndarray]:
    """The first nodes (k, 3) of a plant, and points (m, 3) of the volume that it fills."""
    ball = rng.normal(size=(goals, 3))
    ball *= (rng.random((goals, 1)) ** (1 / 3)) / np.linalg.norm(ball, axis=1, keepdims=True)
    if kind == "tree":
        height = rng.uniform(0.4, 0.7)
        return _bent(rng, height), ball * rng.uniform([0.6, 0.6, 0.55], [0.9, 0.9, 0.9]) + [0, 0, height + 0.6]
    if kind == "coral":
        half = ball * [1.0, 0.22, 1.0] * rng.uniform(0.85, 1.05)
        half[:, 2] = np.abs(half[:, 2]) * rng.uniform(1.0, 1.3)
        return _bent(rng, 0.15), half + [0, 0, 0.2]
    return _bent(rng, 0.3), ball * rng.uniform(0.75, 0.95, size=3) + [0, 0, 1.0]


def _bent(rng: np.random.Generator, height: float) -> np.ndarray:
    """Nodes of a trunk of the given height, bent a little."""
    z = np.arange(0, height + SEGMENT / 2, SEGMENT)
    direction = rng.uniform(0, 2 * pi)
    bend = rng.uniform(0, 0.1) * np.sin(z / height * pi / 2) ** 2
    return np.stack([bend * np.cos(direction), bend * np.sin(direction), z], axis=1)


def _strung(skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Kernels along the segments of a skeleton: centres (m, 3), radii (m,) and distances in radii (m,)."""
    points, parent, radius = skeleton
    centres, radii, spacings = [], [], []
    for node in range(1, len(points)):
        a, b = points[parent[node]], points[node]
        # A side branch has its own thickness from the start: the trunk that it leaves is thicker.
        start, end = min(radius[parent[node]], 1.15 * radius[node]), radius[node]
        length = np.sqrt(((b - a) ** 2).sum())
        number = max(1, ceil(length / (SPACING * (start + end) / 2)))
        t = (np.arange(number) + 0.5)[:, None] / number
        centres.append(a + t * (b - a))
        radii.append((start + t * (end - start))[:, 0])
        spacings.append(length / number / radii[-1])
    return np.vstack(centres), np.concatenate(radii), np.concatenate(spacings)
