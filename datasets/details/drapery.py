"""Sheets of cloth as formulas: curtains, skirts, folded and rolled cloth, and cloth that hangs over a pole.

Folds follow the curve ``x = t - q/2 sin 2t, y = b sin t``. From q = 1 on it leans over, so that each fold has a neck;
at ``t = -arccos(1/q)/2`` and ``pi - t`` both sides of a neck run along y, and are
``pi + arccos(1/q) - sqrt(q^2 - 1)`` apart, which is 0 at q = 4.603.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi, sqrt
from typing import Any, NamedTuple

import numpy as np

from ..surfaces.jets import Jet, cos, sin, smooth_step, stack
from ..surfaces.patch_mesh import graded_lines

LEAST, TOUCHING = 1.6, 4.6034  # q of folds that just lean over, and of folds whose sides touch


class Drapery(NamedTuple):
    """A sheet x(u, v), the lines of its grid, and the gap between its folds."""

    position: Callable[[Jet, Jet], Jet]
    u: np.ndarray
    v: np.ndarray
    gap: float | None  # None where no fold faces another

    @property
    def diagonal(self) -> float:
        """The diagonal of the bounding box before rotation, to about a thousandth."""
        u, v = np.meshgrid(np.linspace(self.u[0], self.u[-1], 513), np.linspace(self.v[0], self.v[-1], 17))
        points = self.position(*Jet.variables(u.ravel(), v.ravel(), 0)).value
        return float(np.linalg.norm(np.ptp(points, axis=1)))


def neck(q: Any) -> Any:
    """The least distance between the sides of a fold, for q from 1 to 4.603, a number or an array; folds are pi
    wide."""
    return pi + np.arccos(1 / q) - np.sqrt(q * q - 1)


def overhang(width: float, nearest: Callable[[float], float] = neck) -> float:
    """The q of folds whose sides are ``width`` apart where nearest, by bisection; 1.6 if that is wider than folds are.

    ``nearest`` gives that distance for a q, in the unit of ``width``.
    """
    low, high = LEAST, TOUCHING
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if nearest(middle) > width else (low, middle)
    return low


def curtain(rng: np.random.Generator, gap: float) -> Drapery:
    """A curtain: shallow folds at the rail, deep ones that lean over below."""
    folds, height = int(rng.integers(6, 13)), rng.uniform(1.2, 1.9)
    pitch = 2 / (folds * pi)
    q, deep = overhang(gap / pitch), rng.uniform(1.6, 3.0)
    ways, starts = rng.uniform(0.2, 0.6, 2), rng.uniform(0, 2 * pi, 3)
    fall = rng.uniform(0.5, 0.9)

    def position(u: Jet, v: Jet) -> Jet:
        share = smooth_step(v * (1 / fall)) * 0.85 + 0.15
        uneven = 1 + 0.14 * sin(u * ways[0] + starts[0]) + 0.1 * sin(u * ways[1] + starts[1])
        x = u - share * (0.5 * q) * sin(2 * u)
        sway = 0.25 * sin(2.0 * v + starts[2]) * v
        return stack(x * pitch + 0.06 * sway, share * uneven * deep * sin(u) * pitch, v * -height)

    return Drapery(
        position, _lines(position, (0, folds * pi), 36 * folds), np.linspace(0, 1, 61), float(pitch * neck(q))
    )


def skirt(rng: np.random.Generator, gap: float) -> Drapery:
    """A skirt: a tube that flares from the waist, its folds turned over at the hem."""
    folds, height = int(rng.integers(7, 13)), rng.uniform(0.9, 1.5)
    waist, hem = rng.uniform(0.25, 0.35), rng.uniform(0.6, 0.8)
    deep, fall = rng.uniform(0.12, 0.2), rng.uniform(0.7, 1.0)
    v = np.linspace(0, 1, 201)
    grown = smooth_step(Jet.variables(v / fall, v, 0)[0]).value
    inner = waist + (hem - waist) * v * (0.6 + 0.4 * v) - 0.63 * grown * deep  # radius where sides are nearest

    def nearest(q: float) -> float:
        return float((inner * neck(np.maximum(q * grown, 1.0)))[grown * q > 1].min()) / folds

    q = overhang(gap, nearest)
    twist = rng.uniform(-0.3, 0.3)

    def position(u: Jet, v: Jet) -> Jet:
        share = smooth_step(v * (1 / fall))
        angle = (u - share * (0.5 * q) * sin(2 * u)) * (1 / folds) + v * twist
        r = waist + (hem - waist) * v * (0.6 + 0.4 * v) + share * deep * sin(u)
        return stack(r * cos(angle), r * sin(angle), v * -height)

    u = _lines(position, (0, 2 * folds * pi), 60 * folds)
    return Drapery(position, u, np.linspace(0, 1, 49), nearest(q))


def napkin(rng: np.random.Generator, gap: float) -> Drapery:
    """A cloth that is folded to and fro, loosely: long layers with a loop at each end."""
    layers = int(rng.integers(5, 10))
    pitch = rng.uniform(0.7, 1.0) / (layers * pi)
    q, deep = overhang(gap / pitch), rng.uniform(0.55, 0.8)
    width, waves, start = rng.uniform(1.0, 1.5), rng.uniform(2, 5), rng.uniform(0, 2 * pi, 2)
    high = rng.uniform(0.02, 0.05)

    def position(u: Jet, v: Jet) -> Jet:
        uneven = 1 + 0.08 * sin(0.7 * u + start[0])
        # All layers get the same shift along their stack, which keeps their distances.
        lift = high * sin(v * waves + start[1])
        return stack(uneven * deep * sin(u), v * width, (u - (0.5 * q) * sin(2 * u)) * pitch + lift)

    u = _lines(position, (-pi / 2, (layers - 0.5) * pi), 44 * layers)
    return Drapery(position, u, np.linspace(-0.5, 0.5, 57), float(pitch * neck(q)))


def scroll(rng: np.random.Generator, gap: float) -> Drapery:
    """A rolled cloth, its outer end loose."""
    turns = rng.uniform(3.2, 6.5)
    step = gap / (2 * pi)
    core, width, slip = rng.uniform(0.15, 0.25), rng.uniform(1.2, 1.8), rng.uniform(-0.04, 0.04)
    loose, start = rng.uniform(0.15, 0.35), 2 * pi * (turns - 0.75)

    def position(u: Jet, v: Jet) -> Jet:
        r = core + u * step + loose * smooth_step((u - start) * (1 / (1.5 * pi)))
        return stack(r * cos(u), r * sin(u), v * width + u * (slip / (2 * pi)))

    u = _lines(position, (0, 2 * pi * turns), round(70 * turns))
    return Drapery(position, u, np.linspace(-0.5, 0.5, 49), gap * sqrt(1 - (step / core) ** 2 / 4))


def drape(rng: np.random.Generator, gap: float) -> Drapery:
    """A square cloth that hangs over a pole: folds grow outwards, and the corners hang lowest."""
    folds, bend = int(rng.integers(5, 9)), rng.uniform(0.3, 0.45)
    deep, turn = rng.uniform(0.25, 0.4), rng.uniform(0, 2 * pi)

    def position(u: Jet, v: Jet) -> Jet:
        square = (u * u + v * v) * (1 / bend**2)
        share = square / (1 + square)
        real, imaginary = u, v  # of (u + i v)^folds, whose angle is ``folds`` times that of (u, v)
        for _ in range(folds - 1):
            real, imaginary = real * u - imaginary * v, real * v + imaginary * u
        wave = (real * np.cos(turn) + imaginary * np.sin(turn)) * (square + 0.02) ** (-folds / 2) * bend**-folds
        r = (1 + square) ** -0.42 * (1 + share * share * deep * wave)
        return stack(u * r, v * r, ((1 + square) ** 0.5 - 1) * -bend)

    lines = np.linspace(-1, 1, 141)
    return Drapery(position, lines, lines, None)


KINDS = {kind.__name__: kind for kind in (curtain, skirt, napkin, scroll, drape)}


def _lines(position: Callable[[Jet, Jet], Jet], ends: tuple[float, float], cells: int) -> np.ndarray:
    """Grid lines of u, closer where the lower border of the sheet turns fast."""
    u = np.linspace(*ends, 20 * cells + 1)
    border = position(*Jet.variables(u, np.ones_like(u), 0)).value.T
    return graded_lines(border, u, cells, 0.4)
