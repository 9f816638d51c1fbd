"""Hair and beards for heads: where they grow, the direction of their strands, and the height of the carving."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..details.strands import Carver, Curls, about_axis
from ..surfaces.duals import Dual, Point, Triple, ease, length, scaled, shifted, sin, soft_abs
from ..surfaces.sculpting import add, ellipsoid, masked, moved, near, raise_by
from .heads import Face, head

SKULL = (0.0, 0.12, 0.22)  # the centres of projection of hair and beard
JAW = (0.0, -0.30, -0.62)
BUN = (0.0, 0.979, -0.203)  # the direction of a bun from the skull's centre
STYLES = ("waves", "curls", "bun", "bald")


class Hair(NamedTuple):
    """A hairstyle: all random choices except the noise."""

    style: str
    axes: np.ndarray  # (3, 3), the last row is where strands start
    wave: float
    turns: float
    swirl: float
    lift: float  # how thick it is
    line: float  # height of the hairline
    beard: bool
    curls: Curls


def draw_hair(rng: np.random.Generator, style: str, *, beard: bool) -> Hair:
    """Hair of a style at random."""
    tilt = 0.42 + rng.uniform(-0.1, 0.1)
    axis = np.array([0.1 * rng.normal(), np.sin(tilt), np.cos(tilt)])
    if style == "bun":
        axis = np.array([0.0, 0.97, 0.05])
    axis /= np.linalg.norm(axis)
    first = np.cross(axis, [1.0, 0.2, 0.1])
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(axis, first), axis])
    return Hair(
        style, axes,
        wave=float(rng.uniform(0.07, 0.15)) if style != "bun" else 0.06,
        turns=float(rng.uniform(1.8, 2.7)),
        swirl=float(rng.choice([-1, 1]) * rng.uniform(0.3, 0.8)) if style != "bun" else 0.0,
        lift=float(rng.uniform(0.07, 0.11)) * (0.4 if style == "bald" else 1.0),
        line=0.70 + float(rng.uniform(-0.06, 0.05)),
        beard=beard,
        curls=Curls(int(rng.integers(110, 170)), rng),
    )  # fmt: skip


def volumes(body: Dual, at: Point, hair: Hair) -> Dual:
    """Large forms below the strands: a bun, a beard."""
    if hair.style == "bun":
        body = add(body, at, (0, 0.94, 0.05), 0.45, 0.14, lambda p: ellipsoid(p, (0, 0.94, 0.05), (0.34, 0.30, 0.32)))
    if hair.beard:
        body = add(body, at, (0, -0.55, -0.95), 0.6, 0.16,
                   lambda p: ellipsoid(p, (0, -0.52, -0.98), (0.36, 0.26, 0.42)))  # fmt: skip
    return body


def add_head(body: Dual, at: Point, face: Face, hair: Hair, carver: Carver, detail: float) -> Dual:
    """The body with a head on it, its hair and beard carved; ``detail`` scales the strands. Units of the head."""

    def part(p: Point) -> Dual:
        skull = volumes(head(p, face), p, hair)
        skull = raise_by(skull, p, near(p, (0, 0.2, 0.1), 2.2), lambda q: _scalp(q, hair, carver, detail))
        if hair.beard:
            skull = raise_by(skull, p, near(p, (0, -0.3, -0.7), 1.6), lambda q: _beard(q, carver, detail))
        return skull

    return add(body, at, (0, 0.0, -0.15), 1.75, 0.12, part)


def _scalp(p: Point, hair: Hair, carver: Carver, detail: float) -> Dual:
    d, (x, y, z) = _projected(p, SKULL, (0.74, 0.88, 0.80))
    ragged = carver.noise((x * 5, y * 3, z * 3), 20) * 0.05
    grows = ease((z + y * 0.95 - hair.line + 0.665 + ragged + _temple(x, y)) * (1 / 0.20))
    sides = soft_abs(x, 0.03)
    ear = length(sides - 0.72, (y - 0.02) * 0.9, (z + 0.10) * 0.62)
    grows = grows * ease((ear - 0.18) * (1 / 0.18)) * ease((z + 0.74) * (1 / 0.14))
    if hair.style == "bald":  # a wreath about the head
        grows = grows * ease((0.56 - z + y * 0.12) * (1 / 0.4))
    return masked(grows, (*d, grows), lambda q: _locks(q[:3], q[3], hair, carver, detail))


def _temple(x: Dual, y: Dual) -> Dual:
    """Hair comes lower beside the forehead than above its middle."""
    return (x.square() * 0.9 - 0.12) * ease((-0.1 - y) * 2.0)


def _locks(d: Point, grown: Dual, hair: Hair, carver: Carver, detail: float) -> Dual:
    if hair.style == "curls":
        fine = carver.noise(scaled(d, 22.0), 30) * 0.010
        return hair.curls.height(d) * grown * (0.12 * detail) + 0.04 + fine * detail
    c, s, way = about_axis(d, hair.axes, hair.wave, hair.turns, hair.swirl)
    # At the axis strands would be infinitely thin: they fade out there.
    fade = ease(way * (1 / 0.5))
    locks = carver.locks(c * 3.8, s * 3.8, way * 1.4, 21, 3) * fade
    height = locks * grown * (0.125 * detail) + hair.lift  # flatter towards its edge
    if hair.style == "bun":
        u, v, w = (a - c for a, c in zip(d, BUN, strict=True))
        knot = ease((0.50 - length(u, v, w)) * (1 / 0.13))
        twist = (u + w) * 2.9
        coil = carver.locks(length(u, w) * 6.3, twist * 0.3, twist * 0.4, 26, 2) * (0.07 * detail)
        return height * (1 - knot) + coil * knot
    return height


def _beard(p: Point, carver: Carver, detail: float) -> Dual:
    d, (x, y, z) = _projected(p, JAW, (0.52, 0.52, 0.72))
    jaw = length(x * 0.95, y + 0.35, (z + 0.78) * 0.85)
    below = ease((y * 0.42 - z - 0.20) * (1 / 0.14)) * ease((0.10 - y) * (1 / 0.2)) * ease((0.80 - jaw) * (1 / 0.2))
    lips = length(x * (1 / 0.29), (z + 0.61) * (1 / 0.125), y * 0.0 + 0.05)
    philtrum = length(x * (1 / 0.11), (z + 0.36) * (1 / 0.10), y * 0.0 + 0.05)
    grows = below * ease((lips - 0.9) * (1 / 0.4)) * ease((philtrum - 0.7) * (1 / 0.5))
    return masked(grows, (x, y, z), lambda q: _whiskers(q, carver, detail))


def _projected(p: Point, centre: Triple, radii: Triple) -> tuple[Point, Point]:
    """The directions of points from a centre, and where these meet an ellipsoid about it.

    A height that depends only on the direction lies over a star-shaped form: no lock overhangs another.
    """
    x, y, z = moved(p, centre)
    r = length(x, y, z) + 1e-9
    d = (x / r, y / r, z / r)
    smooth = 1 / length(*(a * (1 / radius) for a, radius in zip(d, radii, strict=True)))
    return d, shifted(scaled(d, smooth), centre)


def _whiskers(p: Point, carver: Carver, detail: float) -> Dual:
    x, y, z = p
    sides = soft_abs(x, 0.03)
    swing = sin(z * 7.0 + sides * 3.0) * 0.35
    locks = carver.locks(x * 4.6 + swing, y * 3.0, z * 1.3, 34, 3)
    return locks * (0.11 * detail) + 0.03
