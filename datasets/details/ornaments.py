"""Architectural ornament as heights: eggs and darts, beads, volutes, rosettes, engraved letters, tool marks."""

from __future__ import annotations

import numpy as np

from ..surfaces.duals import Dual, Point, atan2, cos, ease, length, scaled, sin, soft_abs
from ..surfaces.sculpting import masked
from .patterns import SEGMENTS
from .strands import Carver


def repeated(along: Dual, period: float) -> Dual:
    """The position within a period, -0.5..0.5."""
    t = along * (1 / period)
    return t - np.round(t.v)


def eggs_and_darts(along: Dual, across: Dual, period: float, width: float) -> Dual:
    """Eggs in their shells with darts between them, 0..1; a band of ``width`` about ``across`` = 0."""
    t, r = repeated(along, period), across * (1 / width)
    oval = length(t * (1 / 0.36), (r - 0.05) * (1 / 0.46), r * 0.0 + 0.02)
    egg = ease((1.0 - oval) * 1.1)
    shell = ease(1 - soft_abs(oval - 1.3, 0.03) * (1 / 0.42)) * 0.5
    dart = ease(1 - (0.5 - soft_abs(t, 0.001)) * (1 / 0.20) - (r + 0.5) * 0.25)
    return (egg + shell + dart * 0.6) * ease((0.5 - soft_abs(r, 0.01)) * 4)


def beads(along: Dual, across: Dual, period: float, width: float) -> Dual:
    """A string of beads, 0..1."""
    t, r = repeated(along, period), across * (1 / width)
    return ease((1 - length(t * (1 / 0.44), r * (1 / 0.5), r * 0.0 + 0.05)) * 1.1)


def volute(u: Dual, v: Dual, radius: float, turns: float, sense: float) -> Dual:
    """A spiral ridge that winds inward to an eye, 0..1."""
    r = length(u, v, u * 0.0 + 1e-3 * radius)
    wind = cos(atan2(v, u) * sense + r * (2 * np.pi * turns / radius))
    rim = ease((radius - r) * (1 / (0.4 * radius)))
    eye = ease((0.30 * radius - r) * (1 / (0.26 * radius)))
    return rim * ((wind * 0.5 + 0.5) * (1 - eye) + eye)


def rosette(u: Dual, v: Dual, radius: float, petals: int) -> Dual:
    """A flower with a round eye, 0..1."""
    r = length(u, v, u * 0.0 + 1e-3 * radius) * (1 / radius)
    angle = atan2(v, u)
    edge = soft_abs(cos(angle * (petals / 2)), 0.08) * 0.45 + 0.55
    leaf = ease((edge - r) * 2.2) * (0.55 + r * 0.45)
    return leaf * ease((r - 0.18) * 3.5) + ease((0.36 - r) * 3.5)


def inscription(u: Dual, v: Dual, text: np.ndarray, height: float) -> Dual:
    """Engraved letters, 1 in the middle of a stroke: rows of ``text`` (rows, columns), indices into the stroke font.

    The field is centred at (0, 0); a letter is ``height`` high and 0.8 of that wide, with its margin.
    """
    rows, columns = text.shape
    x, y = u * (1 / (0.8 * height)) + columns / 2, v * (-1 / height) + rows / 2
    column = np.clip(np.floor(x.v), 0, columns - 1).astype(int)
    row = np.clip(np.floor(y.v), 0, rows - 1).astype(int)
    strokes = SEGMENTS[text[row, column]]
    x, y = x - (column + 0.5), (y - (row + 0.5)) * -1.0
    total = x * 0.0
    for ax, ay, bx, by in np.moveaxis(strokes, 0, 2):
        dx, dy = bx - ax, by - ay
        square = dx * dx + dy * dy
        t = (x - ax) * (dx / square) + (y - ay) * (dy / square)
        t = t.compose(np.clip(t.v, 0, 1), (t.v > 0) & (t.v < 1))
        away = length(x - ax - t * dx, y - ay - t * dy)
        groove = ease(1 - away * (1 / 0.17))
        total = total + groove - total * groove
    return total


def weathering(at: Point, carver: Carver, size: float) -> Dual:
    """Traces of weather and tools, in the unit of ``at``: pores everywhere and worn patches in some places.

    ``size`` is the radius of the shape; pores are 0.0005 of it deep, patches 0.003.
    """
    patch = carver.noise(scaled(at, 3.0 / size), 50)
    pores = carver.noise(scaled(at, 42.0 / size), 51) * (0.0007 * size)
    worn = ease((patch - 0.12) * 3.0)
    rough = masked(worn, at, lambda q: soft_abs(carver.noise(scaled(q, 20.0 / size), 52), 0.05))
    return pores * (0.6 + worn) - rough * (0.006 * size)


def chisel(along: Dual, across: Dual, carver: Carver, layer: int, pitch: float) -> Dual:
    """Parallel marks of a toothed chisel, about 0..1: wavy lines of limited length."""
    wander = carver.noise((along * (0.35 / pitch), across * (0.35 / pitch), across * 0.0), layer) * 1.2
    strength = carver.noise((along * (0.16 / pitch), across * (0.22 / pitch), across * 0.0), layer + 1) + 0.5
    return (sin(across * (2 * np.pi / pitch) + wander) * 0.5 + 0.5) * strength
