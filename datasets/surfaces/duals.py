"""Functions of space with their exact gradients, carried through arithmetic: forward differentiation of first order.

So a body that is written once, as a formula of x, y and z, has exact normals. If only values are needed, the same
formula costs a quarter.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar, cast

import numpy as np

Number = float | np.ndarray
Triple = Sequence[float] | np.ndarray  # three numbers


class Dual:
    """Values ``v`` (n,) of a function at n points and its gradients ``g``: (3, n), (3, 1) if constant, or None."""

    __slots__ = ("g", "v")
    __array_ufunc__ = None  # numpy must leave array * dual to the dual

    def __init__(self, v: np.ndarray, g: np.ndarray | None = None):
        self.v, self.g = v, g

    @staticmethod
    def coordinates(points: np.ndarray, *, gradients: bool) -> tuple[Dual, Dual, Dual]:
        """The functions x, y and z themselves at points (n, 3)."""
        axes = np.eye(3)
        columns = np.ascontiguousarray(points.T)
        x, y, z = (Dual(columns[k], axes[:, k : k + 1] if gradients else None) for k in range(3))
        return x, y, z

    def __getitem__(self, rows: np.ndarray) -> Dual:
        """The same function at some of the points."""
        if self.g is None or self.g.shape[1] == 1:
            return Dual(self.v[rows], self.g)
        return Dual(self.v[rows], self.g[:, rows])

    def compose(self, value: np.ndarray, slope: Number) -> Dual:
        """A function of this one with the given values and derivatives, (n,) each."""
        return Dual(value, None if self.g is None else self.g * slope)

    def __add__(self, other: Dual | Number) -> Dual:
        if not isinstance(other, Dual):
            return Dual(self.v + other, self.g)
        return Dual(self.v + other.v, None if self.g is None else self.g + other.g)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.v, None if self.g is None else -self.g)

    def __sub__(self, other: Dual | Number) -> Dual:
        if not isinstance(other, Dual):
            return Dual(self.v - other, self.g)
        return Dual(self.v - other.v, None if self.g is None else self.g - other.g)

    def __rsub__(self, other: Number) -> Dual:
        return Dual(other - self.v, None if self.g is None else -self.g)

    def __mul__(self, other: Dual | Number) -> Dual:
        if not isinstance(other, Dual):
            return Dual(self.v * other, None if self.g is None else self.g * other)
        return Dual(self.v * other.v, None if self.g is None else self.g * other.v + other.g * self.v)

    __rmul__ = __mul__

    def __truediv__(self, other: Dual | Number) -> Dual:
        if not isinstance(other, Dual):
            return self * (1 / other)
        return self * other.compose(1 / other.v, -1 / other.v**2)

    def __rtruediv__(self, other: Number) -> Dual:
        return self.compose(other / self.v, -other / self.v**2)

    def square(self) -> Dual:
        """This function times itself."""
        return self.compose(self.v * self.v, 2 * self.v)


Point = tuple[Dual, Dual, Dual]
At = TypeVar("At", bound=tuple[Dual, ...])  # a point, and optionally more functions there


def taken(at: At, rows: np.ndarray) -> At:
    """The same functions at some of the points."""
    return cast(At, tuple(part[rows] for part in at))


def scaled(at: Point, factor: Dual | float) -> Point:
    """Coordinates times a factor, a number or a function."""
    x, y, z = at
    return x * factor, y * factor, z * factor


def shifted(at: Point, by: Triple) -> Point:
    """Coordinates, each plus a number."""
    x, y, z = at
    a, b, c = by
    return x + a, y + b, z + c


def dot(at: Point, by: Sequence[Number] | np.ndarray) -> Dual:
    """The sum of the coordinates, each times a number or an array (n,)."""
    x, y, z = at
    a, b, c = by
    return 0.0 + x * a + y * b + z * c  # from 0 on, so that no sum is -0.0


def sqrt(a: Dual) -> Dual:
    """The square root of a positive function."""
    root = np.sqrt(np.maximum(a.v, 1e-300))
    return a.compose(root, 0.5 / root)


def sin(a: Dual) -> Dual:
    """The sine."""
    return a.compose(np.sin(a.v), np.cos(a.v) if a.g is not None else 0)


def cos(a: Dual) -> Dual:
    """The cosine."""
    return a.compose(np.cos(a.v), -np.sin(a.v) if a.g is not None else 0)


def atan2(y: Dual, x: Dual) -> Dual:
    """The angle of (x, y), which is not (0, 0)."""
    value = np.arctan2(y.v, x.v)
    if x.g is None:
        return Dual(value)
    square = np.maximum(x.v**2 + y.v**2, 1e-300)
    return Dual(value, (y.g * x.v - x.g * y.v) / square)


def length(*parts: Dual) -> Dual:
    """The Euclidean norm; where it is 0, so is its gradient."""
    root = np.sqrt(np.maximum(sum(p.v * p.v for p in parts), 1e-300))
    if parts[0].g is None:
        return Dual(root)
    return Dual(root, sum(p.g * (p.v / root) for p in parts))


def soft_abs(a: Dual, width: float) -> Dual:
    """``sqrt(a^2 + width^2)``: the absolute value without its kink."""
    root = np.sqrt(a.v * a.v + width * width)
    return a.compose(root, a.v / root)


def ease(a: Dual) -> Dual:
    """0 for a <= 0, 1 for a >= 1, between them ``a^3 (6 a^2 - 15 a + 10)``: twice continuously differentiable."""
    t = np.clip(a.v, 0, 1)
    return a.compose(t * t * t * (t * (6 * t - 15) + 10), 30 * (t * (1 - t)) ** 2)


def clipped(a: Dual, low: float, high: float) -> Dual:
    """``a`` between two limits."""
    return a.compose(np.clip(a.v, low, high), (a.v > low) & (a.v < high))


def smooth_min(a: Dual, b: Dual, width: float) -> Dual:
    """The twice differentiable minimum of :func:`.blending.smooth_min`."""
    difference = a.v - b.v
    part = np.maximum(1 - np.abs(difference) / width, 0)
    square = part * part
    value = np.minimum(a.v, b.v) - width / 6 * part * square
    if a.g is None:
        return Dual(value)
    return Dual(value, a.g + (0.5 + np.copysign(0.5 - 0.5 * square, difference)) * (b.g - a.g))


def smooth_max(a: Dual, b: Dual, width: float) -> Dual:
    """``-smooth_min(-a, -b)``."""
    return -smooth_min(-a, -b, width)
