"""Signed distance functions of rounded primitives, and smooth booleans of them, with exact gradients.

No slope is steeper than 1. A boolean's value is a lower bound of the distance from outside, not the distance itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .blending import ValueAndGradient, smooth_max, smooth_min

Local = Callable[[np.ndarray], ValueAndGradient]  # a primitive about the origin


class Node(Protocol):
    """A function of space, negative inside."""

    def gradient(self, points: np.ndarray) -> ValueAndGradient:
        """Values (n,) and gradients (n, 3) at points (n, 3)."""
        ...


@dataclass(frozen=True, eq=False)
class Placed:
    """A primitive turned by ``rotation`` (3, 3), then moved to ``centre`` (3,)."""

    local: Local
    centre: np.ndarray
    rotation: np.ndarray

    def gradient(self, points: np.ndarray) -> ValueAndGradient:
        """Values (n,) and gradients (n, 3) at points (n, 3)."""
        value, gradient = self.local(np.einsum("ij,ni->nj", self.rotation, points - self.centre))
        return value, np.einsum("ij,nj->ni", self.rotation, gradient)


@dataclass(frozen=True, eq=False)
class Union:
    """One body and another, with a fillet of about ``width`` between them."""

    one: Node
    other: Node
    width: float

    def gradient(self, points: np.ndarray) -> ValueAndGradient:
        """Values (n,) and gradients (n, 3) at points (n, 3)."""
        return smooth_min(*self.one.gradient(points), *self.other.gradient(points), self.width)


@dataclass(frozen=True, eq=False)
class Intersection:
    """The common part of two bodies, with its edges rounded by about ``width``."""

    one: Node
    other: Node
    width: float

    def gradient(self, points: np.ndarray) -> ValueAndGradient:
        """Values (n,) and gradients (n, 3) at points (n, 3)."""
        return smooth_max(*self.one.gradient(points), *self.other.gradient(points), self.width)


@dataclass(frozen=True, eq=False)
class Difference:
    """One body without another, with the edges of the cut rounded by about ``width``."""

    one: Node
    other: Node
    width: float

    def gradient(self, points: np.ndarray) -> ValueAndGradient:
        """Values (n,) and gradients (n, 3) at points (n, 3)."""
        value, gradient = self.other.gradient(points)
        return smooth_max(*self.one.gradient(points), -value, -gradient, self.width)


@dataclass(frozen=True, eq=False)
class NodeField:
    """A tree of nodes as a :class:`~.field.Field`, turned by ``rotation`` (3, 3)."""

    node: Node
    rotation: np.ndarray

    def value(self, points: np.ndarray) -> np.ndarray:
        """``f`` at points (n, 3): an (n,) array."""
        return self.gradient(points)[0]

    def gradient(self, points: np.ndarray) -> ValueAndGradient:
        """``f`` and its gradient at points (n, 3): (n,) and (n, 3) arrays."""
        value, gradient = self.node.gradient(np.einsum("ij,ni->nj", self.rotation, points))
        return value, np.einsum("ij,nj->ni", self.rotation, gradient)

    def range(self, centres: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """A lower and an upper bound of ``f`` in the balls about ``centres`` (n, 3): two (n,) arrays."""
        value = self.value(centres)
        return value - radius, value + radius


# -- primitives about the origin, their axis along z -------------------------------------------------------------------


def sphere(radius: float) -> Local:
    """A ball."""

    def local(p: np.ndarray) -> ValueAndGradient:
        distance = _length(p)
        return distance - radius, p / distance[:, None]

    return local


def box(half: np.ndarray, rounding: float) -> Local:
    """A box with the half sizes ``half`` (3,), edges and corners rounded by ``rounding``."""
    half = np.asarray(half, dtype=np.float64)

    def local(p: np.ndarray) -> ValueAndGradient:
        value, gradient = _corner(np.abs(p) - half + rounding)
        return value - rounding, np.copysign(gradient, p)

    return local


def cylinder(radius: float, half_height: float, rounding: float) -> Local:
    """A cylinder with rounded rims."""

    def profile(q: np.ndarray) -> ValueAndGradient:
        value, gradient = _corner(np.abs(q) - np.array([radius, half_height]) + rounding)
        return value - rounding, np.copysign(gradient, q)

    return lambda p: _turned(profile, p)


def torus(major: float, minor: float) -> Local:
    """A ring of radius ``major`` and thickness ``2 minor``."""

    def profile(q: np.ndarray) -> ValueAndGradient:
        away = q - np.array([major, 0.0])
        distance = _length(away)
        return distance - minor, away / distance[:, None]

    return lambda p: _turned(profile, p)


def capsule(half_height: float, radius: float) -> Local:
    """All points within ``radius`` of a segment."""

    def local(p: np.ndarray) -> ValueAndGradient:
        away = p.copy()
        away[:, 2] -= np.clip(p[:, 2], -half_height, half_height)
        distance = _length(away)
        return distance - radius, away / distance[:, None]

    return local


def round_cone(height: float, bottom: float, top: float) -> Local:
    """The convex hull of a ball of radius ``bottom`` at the origin and one of ``top`` at ``height`` on the axis."""
    lean = (bottom - top) / height
    along = np.sqrt(1 - lean * lean)

    def profile(q: np.ndarray) -> ValueAndGradient:
        to_top = q - np.array([0.0, height])
        low, high = _length(q), _length(to_top)
        k = along * q[:, 1] - lean * q[:, 0]
        side = along * q[:, 0] + lean * q[:, 1] - bottom
        value = np.where(k < 0, low - bottom, np.where(k > along * height, high - top, side))
        flank = np.broadcast_to([along, lean], q.shape)
        cap = np.where((k > along * height)[:, None], to_top / high[:, None], flank)
        return value, np.where((k < 0)[:, None], q / low[:, None], cap)

    return lambda p: _turned(profile, p)


def _turned(profile: Local, p: np.ndarray) -> ValueAndGradient:
    """A body of revolution about z, from a function of (distance from the axis, z)."""
    rho = np.maximum(np.hypot(p[:, 0], p[:, 1]), 1e-300)
    value, gradient = profile(np.stack([rho, p[:, 2]], axis=1))
    outward = gradient[:, 0] / rho
    return value, np.stack([outward * p[:, 0], outward * p[:, 1], gradient[:, 1]], axis=1)


def _corner(q: np.ndarray) -> ValueAndGradient:
    """The distance to the octant (or quadrant) of all negative coordinates, negative within it."""
    outside = np.maximum(q, 0)
    distance = np.sqrt(np.einsum("ni,ni->n", outside, outside))
    nearest = np.zeros_like(q)
    nearest[np.arange(len(q)), q.argmax(axis=1)] = 1
    inside = distance == 0
    gradient = np.where(inside[:, None], nearest, outside / np.where(inside, 1, distance)[:, None])
    return np.where(inside, q.max(axis=1), distance), gradient


def _length(p: np.ndarray) -> np.ndarray:
    return np.maximum(np.sqrt(np.einsum("ni,ni->n", p, p)), 1e-300)
