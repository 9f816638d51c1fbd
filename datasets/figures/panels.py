"""Carved panels: a head in relief in an oval, scrolls around it, an inscription below, a moulded frame about all."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..details.ornaments import beads, chisel, eggs_and_darts, inscription, rosette, volute
from ..details.patterns import SEGMENTS
from ..details.strands import Carver
from ..surfaces.duals import Dual, Point, ease, length, shifted, smooth_max, smooth_min, soft_abs
from ..surfaces.sculpting import abs_of, add, box, ellipsoid, limb, masked, moved, turn_x, turn_z
from .hair import STYLES, Hair, add_head, draw_hair
from .heads import Face, draw_face

SIZE = 1.62  # the radius of a panel
WIDE, HIGH, BACK = 1.0, 1.28, 0.16  # half the sides, and the distance of the back behind the ground


class Panel(NamedTuple):
    """One panel; front is -y."""

    face: Face
    hair: Hair
    turn: np.ndarray  # of the head
    flat: float  # how flat the head is, 1 for a full one
    text: np.ndarray
    oval: bool
    petals: int
    sense: float  # of the scrolls


def draw_panel(rng: np.random.Generator) -> Panel:
    """A panel at random."""
    style = STYLES[int(rng.integers(len(STYLES)))]
    beard = style != "bun" and bool(rng.random() < 0.5)
    look = float(rng.choice([-1, 1])) * rng.uniform(0.15, 1.15)
    turn = turn_z(look) @ turn_x(0.06 * rng.uniform(-1, 1))
    face, hair = draw_face(rng, woman=style == "bun"), draw_hair(rng, style, beard=beard)
    text = rng.integers(len(SEGMENTS), size=(2, 11))
    return Panel(face, hair, turn, float(rng.uniform(0.55, 0.8)), text, bool(rng.random() < 0.7),
                 int(rng.integers(5, 9)), float(rng.choice([-1, 1])))  # fmt: skip


def panel(at: Point, it: Panel, carver: Carver, detail: float) -> Dual:
    """The function of a panel."""
    x, y, z = at
    block = box(moved(at, (0, BACK - 0.5, 0)), (WIDE, 0.5, HIGH), 0.02)
    ground = masked(_front(y), at, lambda p: _ground(p, it, carver, detail))
    face = (y + ground) * -0.85
    body = smooth_max(block, face, 0.025)
    centre = (0.0, -0.02, 0.27)
    unit = 0.44
    inner = moved(at, centre)
    inner = (inner[0] * (1 / unit), inner[1] * (1 / (unit * it.flat)), inner[2] * (1 / unit))
    pivot = (0.0, 0.12, 0.0)
    inner = shifted(moved(inner, (0, 0, 0), it.turn), pivot)
    scale = 1 / (unit * (0.4 + 0.6 * it.flat))
    body = body * scale
    body = add(body, inner, (0, 0.15, -1.3), 1.4, 0.12, lambda p: _neck(p, it.hair.beard, carver, detail))
    body = add_head(body, inner, it.face, it.hair, carver, detail)
    body = body * (1 / scale)
    # The back is flat: no part of the head protrudes behind.
    return smooth_max(body, y - BACK, 0.02)


def _front(y: Dual) -> Dual:
    return ease((0.08 - y) * (1 / 0.1))


def _neck(p: Point, beard: bool, carver: Carver, detail: float) -> Dual:
    """Neck and shoulders under cloth."""
    x, y, z = p
    neck = limb(p, (0, 0.20, -0.5), (0, 0.2, -1.5), 0.40, 0.44)
    if beard:  # it rests on the breast
        neck = smooth_min(neck, ellipsoid(p, (0, -0.22, -1.28), (0.32, 0.34, 0.42)), 0.2)
    shoulders = ellipsoid(p, (0, 0.18, -1.86), (0.92, 0.52, 0.50))
    covers = ease((-1.36 - z - x.square() * 0.5) * 8)
    folds = masked(covers, p, lambda q: carver.folds(
        (q[2] + q[0].square() * 0.5 + q[1] * 0.3) * 3.6, q[0] * 1.5, 12) * (0.12 * detail) + 0.05)  # fmt: skip
    return smooth_min(neck, shoulders - folds, 0.2)


def _ground(p: Point, it: Panel, carver: Carver, detail: float) -> Dual:
    """How far the front rises over the ground (y = 0), at any depth."""
    x, _, z = p
    ax, az = abs_of(x), abs_of(z)
    edge = smooth_min(WIDE - ax, HIGH - az, 0.02)  # from the rim inwards
    frame = ease((0.30 - edge) * (1 / 0.09)) * 0.070 + ease((0.085 - edge) * (1 / 0.04)) * 0.035
    hollow = masked(ease((edge - 0.26) * 20), p, lambda q: _inside(q, it, carver, detail))
    return frame + masked(ease((0.40 - edge) * 12), p, lambda q: _frame(q, it)) * detail + hollow


def _frame(p: Point, it: Panel) -> Dual:
    x, _, z = p
    ax, az = abs_of(x), abs_of(z)
    # The bands of both directions end at the corner blocks.
    block = 0.28
    upright = ease((ax - (WIDE - block)) * 20) * ease((HIGH - block - az) * 20)
    level = ease((az - (HIGH - block)) * 20) * ease((WIDE - block - ax) * 20)
    corner = ease((ax - (WIDE - block)) * 20) * ease((az - (HIGH - block)) * 20)
    long, short = (HIGH - block) / 8, (WIDE - block) / 6
    relief = masked(upright, p, lambda q: eggs_and_darts(q[2], WIDE - 0.155 - abs_of(q[0]), long, 0.125) * 0.03)
    relief = relief + masked(level, p, lambda q: eggs_and_darts(q[0], HIGH - 0.155 - abs_of(q[2]), short, 0.125) * 0.03)
    relief = relief + masked(corner, p, lambda q: rosette(
        abs_of(q[0]) - (WIDE - 0.15), abs_of(q[2]) - (HIGH - 0.15), 0.115, it.petals) * 0.036)  # fmt: skip
    inner = smooth_min(WIDE - ax, HIGH - az, 0.01) - 0.325
    along = masked(
        ease((HIGH - az - (WIDE - ax)) * 20), p, lambda q: beads(q[2], WIDE - 0.325 - abs_of(q[0]), 0.0666, 0.055)
    )
    across = masked(
        ease((WIDE - ax - (HIGH - az)) * 20), p, lambda q: beads(q[0], HIGH - 0.325 - abs_of(q[2]), 0.0666, 0.055)
    )
    return relief + (along + across) * ease((0.05 - soft_abs(inner, 0.002)) * 25) * 0.022


def _inside(p: Point, it: Panel, carver: Carver, detail: float) -> Dual:
    x, _, z = p
    marks = chisel(x * 0.8 + z * 0.6, z * 0.8 - x * 0.6, carver, 40, 0.055) * (0.006 * detail)
    tablet = masked(ease((-0.66 - z) * 30), p, lambda q: _tablet(q, it)) * detail
    high = ease((z + 0.60) * 20)
    oval = _oval(p, it)
    rim = masked(high, p, lambda q: ease(1 - soft_abs(_oval(q, it) - 1, 0.01) * (1 / 0.09)) * 0.038)
    scrolls = masked(high * ease((oval - 1.06) * 12), p, lambda q: _scrolls(q, it)) * detail
    return marks * ease((oval - 0.5) * 4) + tablet + rim + scrolls


def _oval(p: Point, it: Panel) -> Dual:
    """1 on the rim about the head, an oval or a circle."""
    x, _, z = p
    if it.oval:
        return length(x * (1 / 0.57), (z - 0.20) * (1 / 0.68))
    return length(x, z - 0.24) * (1 / 0.60)


def _tablet(p: Point, it: Panel) -> Dual:
    x, _, z = p
    plate = ease((0.62 - abs_of(x)) * 25) * ease((0.145 - abs_of(z + 0.815)) * 30)
    cut_in = masked(
        plate, p, lambda q: inscription(q[0], q[2] + 0.815, it.text, 0.115) * ease((0.55 - abs_of(q[0])) * 40)
    )
    return plate * 0.03 - cut_in * 0.018


def _scrolls(p: Point, it: Panel) -> Dual:
    x, _, z = p
    ax = abs_of(x)
    up = volute(ax - 0.525, z - 0.80, 0.135, 1.8, it.sense)
    small = volute(ax - 0.59, z - 0.575, 0.075, 1.2, -it.sense)
    low = volute(ax - 0.525, z + 0.38, 0.135, 1.8, -it.sense)
    tiny = volute(ax - 0.59, z + 0.165, 0.075, 1.2, it.sense)
    return (up + small + low + tiny) * 0.034
