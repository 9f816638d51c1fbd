"""Heads for sculptures: a skull with brow, eyes in sockets, nose, lips and ears, by the canon of drawing.

The unit is half the height of the face: chin at z = -1, eyes at 0, crown at 1. Front is -y, left +x.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..surfaces.duals import Dual, Point, length, smooth_max, smooth_min, soft_abs
from ..surfaces.sculpting import add, ball, cut, ellipsoid, limb, moved, turn_x, turn_z


class Face(NamedTuple):
    """Measures of a face, 0 for the mean; about -1 to 1."""

    width: float = 0.0
    jaw: float = 0.0  # broad or narrow
    chin: float = 0.0
    brow: float = 0.0  # how far it protrudes
    nose: float = 0.0  # its length
    hump: float = 0.0  # of the nose's bridge
    wings: float = 0.0  # width of the nose
    lips: float = 0.0  # how full
    mouth: float = 0.0  # how wide; a corner goes up or down with it
    cheeks: float = 0.0
    eyes: float = 0.0  # how open
    age: float = 0.0  # 0 or more: hollow cheeks, folds beside the nose
    pupils: bool = True  # drilled


WOMAN = {"width": -0.3, "jaw": -0.9, "chin": -0.5, "brow": -1.1, "nose": -0.5, "hump": -0.5, "wings": -0.5,
         "lips": 0.5, "cheeks": 0.3}  # fmt: skip


def draw_face(rng: np.random.Generator, *, woman: bool) -> Face:
    """A face at random; a woman's has a narrower jaw, a flatter brow, a shorter nose and fuller lips."""
    values = [round(float(v), 6) for v in np.clip(rng.normal(0, 0.55, size=len(Face._fields) - 2), -1, 1)]
    if woman:
        values = [v + WOMAN.get(name, 0.0) for v, name in zip(values, Face._fields, strict=False)]
    named = dict(zip(Face._fields, values, strict=False))
    return Face(**named, age=round(float(rng.uniform(0, 0.35 if woman else 1)), 6), pupils=bool(rng.random() < 0.6))


def head(at: Point, face: Face) -> Dual:
    """Skull, face and ears, without a neck."""
    x, y, z = at
    p = (soft_abs(x, 0.012), y, z)
    wide = 1 + 0.06 * face.width
    body = ellipsoid(p, (0, 0.12, 0.27), (0.69 * wide, 0.84, 0.74))
    body = smooth_min(body, ellipsoid(p, (0, -0.24, -0.22), (0.54 * wide, 0.50, 0.74)), 0.25)
    body = _jaw(body, p, face, wide)
    body = _brow(body, p, face)
    body = _cheeks(body, p, face, wide)
    body = _nose(body, p, face)
    body = _mouth(body, p, face)
    body = _eye(body, p, face)
    return _ear(body, p, wide)


def _jaw(body: Dual, p: Point, face: Face, wide: float) -> Dual:
    broad = 1 + 0.12 * face.jaw
    angle = np.array([0.43 * wide * broad, 0.0, -0.50])
    corner = np.array([0.13 * broad, -0.53, -0.84])
    body = add(body, p, (angle + corner) / 2, 0.62, 0.16, lambda q: limb(q, angle, corner, 0.17, 0.13))
    up = np.array([0.50 * wide, 0.06, -0.02])
    body = add(body, p, (angle + up) / 2, 0.5, 0.2, lambda q: limb(q, angle, up, 0.16, 0.14))
    out = 0.03 * face.chin
    return add(body, p, (0.04, -0.62 - out, -0.87), 0.24, 0.14,
               lambda q: ellipsoid(q, (0.03, -0.63 - out, -0.87), (0.16, 0.12, 0.12)))  # fmt: skip


def _brow(body: Dual, p: Point, face: Face) -> Dual:
    out = 0.02 * face.brow
    body = add(body, p, (0, -0.35, 0.42), 0.62, 0.2, lambda q: ellipsoid(q, (0, -0.34, 0.40), (0.5, 0.42, 0.42)))
    inner, outer = (0.10, -0.680 - out, 0.165), (0.43, -0.530 - out, 0.175)
    body = add(body, p, (0.27, -0.65, 0.18), 0.40, 0.17, lambda q: limb(q, inner, outer, 0.085, 0.075))
    # The socket lies below the brow, deepest beside the nose.
    return cut(body, p, (0.28, -0.80, 0.0), 0.26, 0.12,
               lambda q: ellipsoid(q, (0.285, -0.79, 0.0), (0.225, 0.17, 0.105), turn_z(-0.30)))  # fmt: skip


def _cheeks(body: Dual, p: Point, face: Face, wide: float) -> Dual:
    full = 1 + 0.12 * face.cheeks
    body = add(body, p, (0.35, -0.44, -0.2), 0.32, 0.24,
               lambda q: ellipsoid(q, (0.345 * wide, -0.445, -0.19), (0.20 * full, 0.155 * full, 0.15)))  # fmt: skip
    hollow = 0.045 * face.age - 0.02
    return cut(body, p, (0.46, -0.60, -0.52), 0.3, 0.2,
               lambda q: ellipsoid(q, (0.49 * wide, -0.60, -0.52), (0.10, 0.105 + hollow, 0.18)))  # fmt: skip


def _nose(body: Dual, p: Point, face: Face) -> Dual:
    tip = np.array([0, -0.955, -0.315 - 0.03 * face.nose])
    root = np.array([0, -0.725, 0.115])
    middle = (root + tip) / 2 + (0, -0.012 - 0.02 * face.hump, 0.0)
    wing = np.array([0.098 + 0.018 * face.wings, -0.83, tip[2] - 0.035])

    def part(q: Point) -> Dual:
        bridge = smooth_min(limb(q, root, middle, 0.062, 0.066), limb(q, middle, tip, 0.066, 0.082), 0.04)
        bulb = smooth_min(bridge, ball(q, tip + (0.012, 0.022, 0.004), 0.088), 0.05)
        wings = ellipsoid(q, wing, (0.062, 0.088, 0.064))
        sides = limb(q, (0.045, -0.63, 0.06), (0.085, -0.71, -0.27), 0.085, 0.095)
        ridge = limb(q, (0, -0.64, 0.08), (0, -0.80, -0.27), 0.095, 0.115)
        return smooth_min(smooth_min(smooth_min(bulb, wings, 0.05), sides, 0.11), ridge, 0.08)

    body = add(body, p, (0, -0.80, -0.12), 0.42, 0.075, part)
    nostril = wing + (-0.048, -0.045, -0.062)
    return cut(body, p, nostril, 0.09, 0.03,
               lambda q: ellipsoid(q, nostril, (0.032, 0.055, 0.045), turn_z(-0.25)))  # fmt: skip


def _mouth(body: Dual, p: Point, face: Face) -> Dual:
    full, wide = 1 + 0.25 * face.lips, 1 + 0.08 * face.mouth
    level = -0.595
    corner = np.array([0.272 * wide, -0.672, level + 0.012 * face.mouth - 0.008])

    def lips(q: Point) -> Dual:
        bow = limb(q, (0.06, -0.770, level + 0.042), corner + (-0.01, 0.015, 0.008), 0.052 * full, 0.024)
        middle = ball(q, (0, -0.778, level + 0.030), 0.048 * full)
        lower = limb(q, (0.05, -0.760, level - 0.056), corner + (-0.035, 0.0, -0.012), 0.060 * full, 0.022)
        return smooth_min(smooth_min(bow, middle, 0.04), lower, 0.012)

    body = add(body, p, (0, -0.55, -0.6), 0.46, 0.2, lambda q: ellipsoid(q, (0, -0.50, -0.60), (0.36, 0.250, 0.27)))
    # The groove from the nose to the lip, and the one below the lips.
    body = cut(
        body, p, (0, -0.84, -0.46), 0.12, 0.06, lambda q: limb(q, (0, -0.845, -0.42), (0, -0.835, -0.52), 0.03, 0.03)
    )
    body = cut(
        body,
        p,
        (0, -0.80, -0.735),
        0.2,
        0.08,
        lambda q: limb(q, (0, -0.83, -0.735), (0.12, -0.79, -0.725), 0.05, 0.045),
    )
    body = add(body, p, (0, -0.75, level), 0.32, 0.035, lips)
    line = [
        np.array([0, -0.842, level + 0.002]),
        np.array([0.13 * wide, -0.812, level - 0.004]),
        corner + (0.02, -0.02, 0),
    ]

    def gap(q: Point) -> Dual:
        return smooth_min(limb(q, line[0], line[1], 0.022, 0.020), limb(q, line[1], line[2], 0.020, 0.018), 0.02)

    body = cut(body, p, (0.06, -0.78, level), 0.3, 0.03, gap)
    if face.age > 0.25:  # the fold from the wing of the nose to the corner of the mouth
        start, end = np.array([0.185, -0.735, -0.34]), np.array([0.315, -0.60, -0.60])
        depth = 0.012 + 0.012 * face.age
        body = cut(
            body,
            p,
            (start + end) / 2,
            0.3,
            0.09,
            lambda q: limb(q, start + (0, -0.055, 0), end + (0, -0.055, 0), depth, depth),
        )
    return body


def _eye(body: Dual, p: Point, face: Face) -> Dual:
    centre = np.array([0.292, -0.525, 0.005])
    radius = 0.142
    turn = turn_z(-0.20)
    upper, lower = 0.52 + 0.12 * face.eyes, -0.36 - 0.05 * face.eyes

    def ball_of_eye(q: Point) -> Dual:
        u, v, w = moved(q, centre, turn)
        eyeball = length(u, v, w) - radius
        if not face.pupils:
            return eyeball
        spot = length(u, v + radius, w - 0.012) - 0.036
        return smooth_max(eyeball, -spot, 0.02)

    def lids(q: Point) -> Dual:
        u, v, w = moved(q, centre + (0, -0.004, 0), turn)
        shell = length(u * 0.92, v, w) - (radius + 0.028)
        above = w * np.cos(upper) + v * np.sin(upper)
        below = -(w * np.cos(lower) + v * np.sin(lower))
        opening = smooth_max(above, below, 0.012)
        return smooth_max(shell, -opening, 0.022)

    body = add(body, p, centre, radius, 0.018, ball_of_eye)
    body = add(body, p, centre, radius + 0.05, 0.030, lids)
    corner = centre + turn.T @ np.array([-0.150, -0.052, -0.012])
    return add(body, p, corner, 0.05, 0.03, lambda q: ball(q, corner, 0.024))


def _ear(body: Dual, p: Point, wide: float) -> Dual:
    centre = np.array([0.665 * wide + 0.03, 0.10, -0.06])
    turn = turn_x(-0.22) @ turn_z(-0.42)

    def part(q: Point) -> Dual:
        u, v, w = moved(q, centre, turn)
        # An oval that is broad above, with a rim, a hollow and a lobe.
        oval = length((v + w * 0.12) * (1 / 0.155), w * (1 / 0.27))
        plate = smooth_max((oval - 1) * 0.155, soft_abs(u, 0.02) - 0.05, 0.05)
        hollow = length((u - 0.075) * (1 / 0.075), (v + 0.01 + w * 0.12) * (1 / 0.105), (w - 0.02) * (1 / 0.2))
        plate = smooth_max(plate, (1 - hollow) * 0.075, 0.035)
        inner = limb((u, v, w), (0.02, 0.045, 0.13), (0.03, 0.03, -0.12), 0.026, 0.034)
        lobe = ellipsoid((u, v, w), (0.0, -0.005, -0.235), (0.045, 0.075, 0.075))
        tragus = ball((u, v, w), (0.02, -0.125, -0.04), 0.035)
        return smooth_min(smooth_min(smooth_min(plate, inner, 0.035), lobe, 0.05), tragus, 0.04)

    above, below = (np.array([0.575 * wide, 0.22, z]) for z in (0.06, -0.20))  # no gap is left behind the ear
    body = add(body, p, (0.575 * wide, 0.22, -0.07), 0.3, 0.22, lambda q: limb(q, above, below, 0.12, 0.11))
    return add(body, p, centre, 0.36, 0.09, part)
