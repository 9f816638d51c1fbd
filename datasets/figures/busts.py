"""Busts: head, neck, shoulders and breast, bare or draped, cut off below and set on a turned foot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..details.strands import Carver
from ..surfaces.duals import Dual, Point, ease, length, shifted, smooth_max, smooth_min, soft_abs
from ..surfaces.sculpting import (
    add,
    box,
    disc,
    ellipsoid,
    limb,
    masked,
    moved,
    near,
    raise_by,
    ring,
    turn_x,
    turn_y,
    turn_z,
)
from .hair import Hair, add_head, draw_hair
from .heads import Face, draw_face

SIZE = 2.6  # the radius of a bust in units of a head
PIVOT = (0.0, 0.2, -0.75)  # of the head on the neck


class Bust(NamedTuple):
    """One bust; units of a head (see :mod:`.heads`)."""

    face: Face
    hair: Hair
    turn: np.ndarray  # of the head on the neck
    broad: float
    draped: bool
    lean: float  # of the folds
    square: bool  # a square foot instead of a round one


def draw_bust(rng: np.random.Generator, style: str) -> Bust:
    """A bust at random with hair of a style."""
    face = draw_face(rng, woman=style == "bun")
    beard = style != "bun" and bool(rng.random() < (0.8 if style == "bald" else 0.45))
    turn = turn_z(0.35 * rng.uniform(-1, 1)) @ turn_x(rng.uniform(-0.08, 0.12)) @ turn_y(0.1 * rng.uniform(-1, 1))
    broad = 1 + 0.07 * float(rng.uniform(-1, 1)) - (0.08 if style == "bun" else 0)
    return Bust(face, draw_hair(rng, style, beard=beard), turn, broad, bool(rng.random() < 0.6),
                float(rng.choice([-1, 1])), bool(rng.random() < 0.5))  # fmt: skip


def bust(at: Point, it: Bust, carver: Carver, detail: float) -> Dual:
    """The function of a bust."""
    body = _torso(at, it)
    body = _carved_cloth(body, at, it, carver, detail) if it.draped else body
    body = _trimmed(body, at)
    inner = shifted(moved(at, PIVOT, it.turn), PIVOT)
    body = add_head(body, inner, it.face, it.hair, carver, detail)
    return _foot(body, at, it)


def _torso(at: Point, it: Bust) -> Dual:
    x, y, z = at
    p = (soft_abs(x, 0.03), y, z)
    b = it.broad
    body = limb(at, (0, 0.20, -0.55), (0, 0.26, -1.75), 0.42 * b, 0.47 * b)
    chest = ellipsoid(p, (0, 0.17, -2.30), (1.10 * b, 0.66, 0.95))
    body = smooth_min(body, chest, 0.35)
    body = smooth_min(body, limb(p, (0.25, 0.25, -1.45), (1.05 * b, 0.22, -1.86), 0.22, 0.30), 0.30)
    body = add(
        body, p, (1.18 * b, 0.17, -2.15), 0.60, 0.3, lambda q: ellipsoid(q, (1.18 * b, 0.17, -2.15), (0.38, 0.42, 0.55))
    )
    body = add(
        body, p, (0.5, -0.33, -2.32), 0.62, 0.3, lambda q: ellipsoid(q, (0.50, -0.26, -2.30), (0.50, 0.26, 0.36))
    )
    body = add(
        body,
        p,
        (0.6, -0.2, -1.75),
        0.65,
        0.12,
        lambda q: limb(q, (0.13, -0.26, -1.80), (1.02 * b, 0.05, -1.66), 0.075, 0.085),
    )
    return add(
        body, p, (0.3, 0.0, -1.1), 0.85, 0.14, lambda q: limb(q, (0.34, 0.20, -0.66), (0.10, -0.24, -1.77), 0.11, 0.075)
    )


def _carved_cloth(body: Dual, at: Point, it: Bust, carver: Carver, detail: float) -> Dual:
    def height(p: Point) -> Dual:
        x, y, z = p
        u = x * it.lean
        # Cloth lies over one shoulder and runs to the other side: its hem is lower in the middle.
        hem = z + 1.86 - u * 0.52 - ease((y + 0.1) * 1.4) * 0.30 + (x.square()) * 0.10
        covers = ease((-hem) * (1 / 0.13))
        return masked(covers, (*p, hem), folded)

    def folded(p: tuple[Dual, ...]) -> Dual:
        x, y, z, hem = p
        u = x * it.lean
        across = z * 1.0 - u * 0.75 + x.square() * 0.30 + y * 0.2
        along = u * 1.0 + z * 0.55 + y * 0.3
        bend = carver.noise((x * 0.9, y * 0.9, z * 0.9), 5) * 0.35
        folds = carver.folds((across + bend) * 3.4, along * 1.4, 6)
        rolled = ease(1 - soft_abs(hem + 0.15, 0.03) * (1 / 0.16)) * 0.05
        return folds * (0.17 * detail) + 0.05 + rolled

    return raise_by(body, at, near(at, (0, 0.17, -2.3), 1.9), height)


def _trimmed(body: Dual, at: Point) -> Dual:
    """Arms and lower breast cut off along a round line."""
    return smooth_max(body, ellipsoid(at, (0, 0.15, -1.55), (1.50, 1.10, 1.32)), 0.12)


def _foot(body: Dual, at: Point, it: Bust) -> Dual:
    def turned(p: Point) -> Dual:
        r, h = length(p[0], p[1] - 0.2), p[2]
        stem = disc(r, h + 3.0, 0.30, 0.42, 0.05)
        stem = smooth_min(stem, ring(r, h, 0.30, -2.92, 0.10), 0.06)
        stem = smooth_min(stem, ring(r, h, 0.42, -3.30, 0.09), 0.05)
        stem = smooth_min(stem, disc(r, h + 3.22, 0.36, 0.10, 0.04), 0.12)
        if it.square:
            return smooth_min(stem, box(moved(p, (0, 0.2, -3.53)), (0.60, 0.60, 0.16), 0.035), 0.05)
        return smooth_min(stem, disc(r, h + 3.53, 0.62, 0.16, 0.04), 0.05)

    return add(body, at, (0, 0.2, -3.15), 1.05, 0.10, turned)
