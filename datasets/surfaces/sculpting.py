"""Bodies as formulas of :class:`.duals.Dual`: primitives, smooth unions that evaluate parts locally, and the field.

A primitive is positive outside and nearly a distance: exact for balls, cones' axes and boxes, of first order for
ellipsoids (Quilez, iquilezles.org/articles/distfunctions).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .duals import At, Dual, Point, Triple, clipped, dot, length, smooth_max, smooth_min, taken

Form = Callable[[Point], Dual]


@dataclass(frozen=True, eq=False)
class Sculpture:
    """A formula as a :class:`~.field.Field`, turned by ``rotation`` (3, 3).

    ``slope`` bounds the norm of its gradient near the surface.
    """

    form: Form
    slope: float
    rotation: np.ndarray

    def value(self, points: np.ndarray) -> np.ndarray:
        """``f`` at points (n, 3): an (n,) array."""
        return self.form(Dual.coordinates(points @ self.rotation.T, gradients=False)).v

    def gradient(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``f`` and its gradient at points (n, 3): (n,) and (n, 3) arrays."""
        found = self.form(Dual.coordinates(points @ self.rotation.T, gradients=True))
        assert found.g is not None  # gradients were requested
        return found.v, found.g.T @ self.rotation

    def range(self, centres: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """A lower and an upper bound of ``f`` in the balls about ``centres`` (n, 3): two (n,) arrays."""
        value = self.value(centres)
        return value - self.slope * radius, value + self.slope * radius


# -- where a part is ---------------------------------------------------------------------------------------------------


def add(body: Dual, at: Point, centre: Triple, reach: float, width: float, part: Form) -> Dual:
    """The smooth union with a part within ``reach`` of ``centre``, evaluated only where it may have an effect."""
    beyond = _distance(at, centre) - reach
    return _merged(body, at, beyond < body.v + width, lambda a, p: smooth_min(a, part(p), width))


def cut(body: Dual, at: Point, centre: Triple, reach: float, width: float, hole: Form) -> Dual:
    """The smooth difference with a hole within ``reach`` of ``centre``."""
    beyond = _distance(at, centre) - reach
    return _merged(body, at, beyond < width - body.v, lambda a, p: smooth_max(a, -hole(p), width))


def raise_by(body: Dual, at: Point, rows: np.ndarray, height: Form) -> Dual:
    """The body with ``height`` added to it where the mask ``rows`` is true; the height is 0 at the mask's border."""
    return _merged(body, at, rows, lambda a, p: a - height(p))


def masked(weight: Dual, at: At, height: Callable[[At], Dual]) -> Dual:
    """``weight * height``, where the height is evaluated only where the weight is not 0."""
    rows = weight.v != 0
    if rows.mean() > 0.8:
        return weight * height(at)
    rows = np.flatnonzero(rows)
    value = np.zeros(len(weight.v))
    gradient = None if weight.g is None else np.zeros((3, len(value)))
    if len(rows):
        part = weight[rows] * height(taken(at, rows))
        value[rows] = part.v
        if gradient is not None:
            gradient[:, rows] = part.g
    return Dual(value, gradient)


def near(at: Point, centre: Triple, reach: float) -> np.ndarray:
    """Which points are within ``reach`` of ``centre``: an (n,) mask."""
    return _distance(at, centre) < reach


def _distance(at: Point, centre: Triple) -> np.ndarray:
    return np.sqrt(sum((p.v - c) ** 2 for p, c in zip(at, centre, strict=True)))


def _merged(body: Dual, at: Point, rows: np.ndarray, change: Callable[[Dual, Point], Dual]) -> Dual:
    if not rows.any():
        return body
    if rows.mean() > 0.8:
        return change(body, at)
    rows = np.flatnonzero(rows)
    changed = change(body[rows], taken(at, rows))
    value = body.v.copy()
    value[rows] = changed.v
    if body.g is None:
        return Dual(value)
    gradient = body.g.copy()
    gradient[:, rows] = changed.g
    return Dual(value, gradient)


# -- places ------------------------------------------------------------------------------------------------------------


def moved(at: Point, centre: Triple, turn: np.ndarray | None = None) -> Point:
    """Coordinates about ``centre`` along the rows of ``turn`` (3, 3)."""
    x, y, z = (p - float(c) for p, c in zip(at, centre, strict=True))
    if turn is None:
        return x, y, z
    u, v, w = (x * float(a) + y * float(b) + z * float(c) for a, b, c in turn)
    return u, v, w


def turn_x(angle: float) -> np.ndarray:
    """Rows of the axes turned by ``angle`` about x."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, s], [0, -s, c]])


def turn_y(angle: float) -> np.ndarray:
    """Rows of the axes turned by ``angle`` about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def turn_z(angle: float) -> np.ndarray:
    """Rows of the axes turned by ``angle`` about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


# -- primitives --------------------------------------------------------------------------------------------------------


def ball(at: Point, centre: Triple, radius: float) -> Dual:
    """A ball."""
    return length(*moved(at, centre)) - radius


def ellipsoid(at: Point, centre: Triple, radii: Triple, turn: np.ndarray | None = None) -> Dual:
    """An ellipsoid along the axes, or along the rows of ``turn``."""
    p = moved(at, centre, turn)
    q = [a * (1 / r) for a, r in zip(p, radii, strict=True)]
    k0 = length(*q)
    k1 = length(*(a * (1 / r) for a, r in zip(q, radii, strict=True)))
    return k0 * (k0 - 1) / (k1 + 1e-9)


def limb(at: Point, start: Triple, end: Triple, radius: float, other: float) -> Dual:
    """A rod between two points, its radius easing from one value to another."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = end - start
    offset = moved(at, start)
    square = float(axis @ axis)
    along = clipped(dot(offset, [float(a / square) for a in axis]), 0.0, 1.0)
    away = length(*(p - along * float(a) for p, a in zip(offset, axis, strict=True)))
    if radius == other:
        return away - radius
    t = along.v
    return away - along.compose(radius + (other - radius) * t * t * (3 - 2 * t), (other - radius) * 6 * t * (1 - t))


def box(at: Point, half: Triple, rounding: float) -> Dual:
    """A box about the origin with rounded edges."""
    over = [_beyond(p, float(h) - rounding) for p, h in zip(at, half, strict=True)]
    return length(*over) - rounding + _inner([abs_of(p) - (float(h) - rounding) for p, h in zip(at, half, strict=True)])


def abs_of(a: Dual) -> Dual:
    """The absolute value."""
    return a.compose(np.abs(a.v), np.sign(a.v))


def _beyond(a: Dual, limit: float) -> Dual:
    return a.compose(np.maximum(np.abs(a.v) - limit, 0), np.where(np.abs(a.v) > limit, np.sign(a.v), 0.0))


def _inner(depths: list[Dual]) -> Dual:
    """The largest of some coordinates where all are negative, else 0."""
    values = np.stack([d.v for d in depths])
    deepest = values.argmax(axis=0)
    value = np.minimum(values.max(axis=0), 0)
    if depths[0].g is None:
        return Dual(value)
    chosen = [(deepest == k) & (value < 0) for k in range(len(depths))]
    return Dual(value, sum(d.g * mask for d, mask in zip(depths, chosen, strict=True)))


def disc(rho: Dual, z: Dual, radius: float, half: float, rounding: float) -> Dual:
    """A cylinder about z with rounded rims, from the distance ``rho`` to its axis."""
    depths = [rho - (radius - rounding), abs_of(z) - (half - rounding)]
    return length(*(d.compose(np.maximum(d.v, 0), d.v > 0) for d in depths)) - rounding + _inner(depths)


def ring(rho: Dual, z: Dual, radius: float, height: float, thickness: float) -> Dual:
    """A torus about z."""
    return length(rho - radius, z - height) - thickness
