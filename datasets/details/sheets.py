"""The middle surfaces of plates, and the closed surfaces around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import cos as cosine
from math import pi, radians
from math import sin as sine

import numpy as np

from ..surfaces.jets import Jet, cos, sin, stack, unit_normal
from ..surfaces.parametric import Chart, Patch
from ..surfaces.shells import Position, flat_end, offset, round_end

LENGTH = 2.0  # approximate length of a sheet along u; folded ones have it when unrolled
ROUND_CELLS = 10  # across a half-round end

# Folds as angles in degrees between flats of the given relative lengths.
FOLDS: dict[str, tuple[Sequence[float], Sequence[float]]] = {
    "hat": ([1, 1, 1.4, 1, 1], [80, -80, -80, 80]),
    "hem": ([1.5, 1], [180]),
    "zigzag": ([1, 1, 1, 1, 1], [-95, 95, -95, 95]),
    "channel": ([1, 1.5, 1], [90, 90]),
}


@dataclass(frozen=True, eq=False)
class Middle:
    """A middle surface: pieces (position, low, high) in a row along u, and the half-width in v."""

    name: str
    pieces: list[tuple[Position, float, float]]
    width: float  # v runs from -width / 2 to width / 2
    finest: float  # radius of the tightest bend
    symmetry: str
    gap: float | None = None  # between parts that face each other, if they come near


def flat(rng: np.random.Generator, thickness: float, turn: int) -> Middle:
    """A rectangle."""
    width = rng.uniform(1.0, 1.8)
    return Middle("flat", [(_graph(lambda u, v: 0.0 * u), -1.0, 1.0)], width, np.inf, "mirror x, y and z")


def corrugated(rng: np.random.Generator, thickness: float, turn: int) -> Middle:
    """A sine wave along u."""
    k = pi * rng.uniform(2.5, 6.0)
    # The offset surfaces are smooth while half the thickness is below the smallest radius of curvature, 1 / (a k^2).
    a = min(rng.uniform(0.8, 1.3) / k, 1 / (1.2 * thickness * k * k))
    wave = _graph(lambda u, v: a * sin(k * u))
    return Middle("corrugated", [(wave, -1.0, 1.0)], rng.uniform(1.0, 1.6), 1 / (a * k * k), "rotation 2 about y")


def egg_box(rng: np.random.Generator, thickness: float, turn: int) -> Middle:
    """A sine wave in both directions."""
    k = pi * int(rng.integers(3, 6))
    a = min(rng.uniform(0.6, 0.9) / k, 1 / (1.4 * thickness * k * k))
    waves = _graph(lambda u, v: a * sin(k * u) * sin(k * v))
    width = 2 * int(rng.integers(round(0.55 * k / pi), round(0.9 * k / pi) + 1)) * pi / k
    return Middle("egg box", [(waves, -1.0, 1.0)], width, 1 / (a * k * k), "rotation 2 about z")


def folded(rng: np.random.Generator, thickness: float, turn: int) -> Middle:
    """Flats with round bends between them."""
    name = list(FOLDS)[turn % len(FOLDS)]
    lengths, turns = FOLDS[name]
    scale = 1.2 * LENGTH / sum(lengths)
    lengths = [scale * length * rng.uniform(0.9, 1.1) for length in lengths]
    radius = 0.7 * thickness + (0.01 if name == "hem" else rng.uniform(0.02, 0.08))
    pieces, at, heading = [], np.zeros(2), 0.0
    for k, length in enumerate(lengths):
        direction = np.array([cosine(heading), sine(heading)])
        pieces.append((_straight(at, direction), 0.0, length))
        at = at + length * direction
        if k < len(turns):
            angle = radians(turns[k])
            pieces.append((_bend(at, heading, radius, float(np.sign(angle))), 0.0, abs(angle)))
            side = np.sign(angle) * np.array([-direction[1], direction[0]])
            centre = at + radius * side
            heading += angle
            at = centre - np.sign(angle) * radius * np.array([-sine(heading), cosine(heading)])
    gap = 2 * radius - thickness if name == "hem" else None
    return Middle(name, pieces, rng.uniform(0.9, 1.4), radius, "mirror y", gap)


def _graph(height) -> Position:
    return lambda u, v: stack(u, v, height(u, v))


def _straight(at: np.ndarray, direction: np.ndarray) -> Position:
    return lambda u, v: stack(u * direction[0] + at[0], v, u * direction[1] + at[1])


def _bend(at: np.ndarray, heading: float, radius: float, sign: float) -> Position:
    def position(u: Jet, v: Jet) -> Jet:
        angle = u * sign + heading
        x = (sin(angle) - sine(heading)) * (sign * radius) + at[0]
        z = (cosine(heading) - cos(angle)) * (sign * radius) + at[1]
        return stack(x, v, z)

    return position


@dataclass(frozen=True, eq=False)
class Sheet:
    """The closed surface around a middle surface."""

    middle: Middle
    thickness: float
    ends: str  # "flat" or "round"
    spacing: float

    @cached_property
    def diagonal(self) -> float:
        """The diagonal of the bounding box before rotation, to about a thousandth."""
        points = []
        for position, low, high in self.middle.pieces:
            u, v = np.meshgrid(np.linspace(low, high, 65), np.linspace(-0.5, 0.5, 33) * self.middle.width)
            x = position(*Jet.variables(u.ravel(), v.ravel(), 1))
            normal = unit_normal(x).value * (self.thickness / 2)
            points += [x.value + normal, x.value - normal]
        extents = np.ptp(np.concatenate(points, axis=1), axis=1)
        if self.ends == "round":
            extents[:2] += self.thickness
        return float(np.linalg.norm(extents))

    def parts(self) -> tuple[list[Chart], list[Patch]]:
        """Both faces, and the ends around."""
        half = self.thickness / 2
        v = _lines(-self.middle.width / 2, self.middle.width / 2, self.middle.width, self.spacing)
        charts, patches = [], []

        def add(position: Position, flip: bool, u: np.ndarray, v: np.ndarray) -> None:
            charts.append(Chart(position, flip=flip, lost=1))
            patches.append(Patch(len(charts) - 1, u, v))

        if self.ends == "round":
            s, end, measure = np.linspace(-pi / 2, pi / 2, ROUND_CELLS + 1), round_end, 1.0
        else:
            s, end, measure = _lines(-1.0, 1.0, self.thickness, self.spacing), flat_end, 1.0
        pieces = self.middle.pieces
        for k, (position, low, high) in enumerate(pieces):
            u = _lines(low, high, self._length(position, low, high), self.spacing)
            if len(pieces) > 1 and k % 2:  # a bend: at most 10 degrees per cell
                u = np.linspace(low, high, max(len(u), int((high - low) / radians(9)) + 1))
            add(offset(position, half), False, u, v)
            add(offset(position, -half), True, u, v)
            for at, outward in ((v[0], -1.0), (v[-1], 1.0)):
                add(self._end(end, position, at, 1, outward, half * measure), outward < 0, s, u)
        for (position, low, high), first in ((pieces[0], True), (pieces[-1], False)):
            at, outward = (low, -1.0) if first else (high, 1.0)
            add(self._end(end, position, at, 0, outward, half * measure), outward > 0, s, v)
            if self.ends == "round":
                q = np.linspace(0, pi / 2, ROUND_CELLS // 2 + 1)
                for corner, sign in ((v[0], -1.0), (v[-1], 1.0)):
                    add(_corner(position, at, corner, outward, sign, half), outward * sign > 0, s, q)
        return charts, patches

    def _end(self, end, position: Position, at: float, axis: int, outward: float, half: float) -> Position:
        return end(position, at, axis, outward, half) if end is round_end else end(position, at, axis, half)

    def _length(self, position: Position, low: float, high: float) -> float:
        u = np.linspace(low, high, 501)
        x = position(*Jet.variables(u, np.full(501, 0.5 * pi / 7), 0)).value.T
        return sum(float(np.linalg.norm(b - a)) for a, b in pairwise(x))


def _corner(middle: Position, u: float, v: float, side_u: float, side_v: float, half: float) -> Position:
    """The quarter of a sphere between two half-round ends that meet at a right angle."""
    x = middle(*Jet.variables(np.array([u]), np.array([v]), 1))
    centre, x_u, x_v = x.c[:, :, 0]
    normal = np.cross(x_u, x_v) / np.linalg.norm(np.cross(x_u, x_v))
    b_u, b_v = side_u * x_u / np.linalg.norm(x_u), side_v * x_v / np.linalg.norm(x_v)

    def position(s: Jet, q: Jet) -> Jet:
        a, b, c = cos(s) * cos(q) * half, cos(s) * sin(q) * half, sin(s) * half
        return stack(*(centre[k] + a * b_u[k] + b * b_v[k] + c * normal[k] for k in range(3)))

    return position


def _lines(low: float, high: float, length: float, spacing: float) -> np.ndarray:
    return np.linspace(low, high, max(1, round(length / spacing)) + 1)
