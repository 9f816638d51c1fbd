"""Draped figures: a standing body in a long dress and a mantle, one arm free, on a plinth; metres, z up, facing -y."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..details.strands import Carver
from ..surfaces.duals import Dual, Point, ease, length, scaled, shifted, sin, smooth_max, smooth_min, soft_abs
from ..surfaces.sculpting import (
    Form,
    add,
    box,
    disc,
    ellipsoid,
    limb,
    masked,
    moved,
    raise_by,
    ring,
    turn_x,
    turn_y,
    turn_z,
)
from .hair import Hair, add_head, draw_hair
from .heads import Face, draw_face
from .poses import joint_rotations
from .skeleton import ENDS, NAMES, REST, forward

HEAD = 0.122  # the unit of the head in metres
SIZE = 1.08  # the radius of a figure
STANCES = {
    "orator": {"arm_raise": 22, "arm_swing": 35, "elbow": 55, "wrist": -10, "curl": 12},
    "offering": {"arm_raise": -34, "arm_swing": 18, "elbow": 88, "curl": 30},
    "greeting": {"arm_raise": 48, "arm_swing": 10, "elbow": 78, "arm_twist": -40, "curl": 6},
    "reader": {"arm_raise": -30, "arm_swing": 30, "elbow": 100, "forearm_twist": 30, "curl": 50},
}


class Draped(NamedTuple):
    """One figure."""

    face: Face
    hair: Hair
    look: np.ndarray  # the turn of the head
    side: float  # 1: the left arm is free and the right knee bent; -1: the other way round
    joints: np.ndarray  # (joints, 3) of the pose
    ends: np.ndarray
    turns: np.ndarray
    stout: float
    sway: float
    mantle: bool
    square: bool


def draw_draped(rng: np.random.Generator, stance: str) -> Draped:
    """A figure in a stance at random."""
    woman = rng.random() < 0.5
    style = "bun" if woman else ("waves", "curls", "bald")[int(rng.integers(3))]
    face = draw_face(rng, woman=bool(woman))
    hair = draw_hair(rng, style, beard=not woman and bool(rng.random() < 0.6))
    look = turn_z(0.5 * rng.uniform(-1, 1)) @ turn_x(rng.uniform(-0.12, 0.1)) @ turn_y(0.12 * rng.uniform(-1, 1))
    side = float(rng.choice([-1, 1]))
    free, held = ("left", "right") if side > 0 else ("right", "left")
    angles = {f"{free}_{name}": angle + 5 * rng.normal() for name, angle in STANCES[stance].items()}
    angles |= {f"{held}_arm_raise": -40.0, f"{held}_elbow": 48.0, f"{held}_arm_swing": 14.0, f"{held}_curl": 25.0}
    turns, shifts = forward(REST, joint_rotations(angles))
    joints = np.einsum("jab,jb->ja", turns, REST) + shifts
    ends = np.einsum("jab,jb->ja", turns, ENDS) + shifts
    stout = 1 + 0.07 * float(rng.uniform(-1, 1)) - 0.04 * woman
    return Draped(face, hair, look, side, joints, ends, turns, stout, float(rng.uniform(0.012, 0.028)) * side,
                  bool(rng.random() < 0.75), bool(rng.random() < 0.5))  # fmt: skip


def draped(at: Point, it: Draped, carver: Carver, detail: float) -> Dual:
    """The function of a figure."""
    x, y, z = at
    # An easy stance: hips to one side, shoulders to the other.
    p = (x - sin((z - 0.25) * (np.pi / 0.75)) * it.sway, y, z)
    body = _form(p, it)
    body = raise_by(body, p, z.v < 1.6, lambda q: _cloth(q, it, carver, detail))
    body = _bare(body, p, it)
    inner = scaled(moved(p, (0, -0.012, 1.662)), 1 / HEAD)
    pivot = (0.0, 0.2, -0.75)
    inner = shifted(moved(inner, pivot, it.look), pivot)
    body = add_head(body * (1 / HEAD), inner, it.face, it.hair, carver, detail) * HEAD
    return _plinth(body, at, it)


def _form(p: Point, it: Draped) -> Dual:
    """The body under the cloth."""
    x, y, z = p
    b = it.stout
    m = (soft_abs(x, 0.004), y, z)
    torso = smooth_min(ellipsoid(p, (0, 0.0, 1.09), (0.132 * b, 0.10 * b, 0.14)),
                       ellipsoid(p, (0, 0.0, 1.27), (0.148 * b, 0.102 * b, 0.18)), 0.08)  # fmt: skip
    torso = smooth_min(torso, ellipsoid(m, (0.075, -0.05, 1.31), (0.075, 0.06, 0.062)), 0.06)
    torso = smooth_min(torso, limb(m, (0.05, 0.02, 1.455), (0.175 * b, 0.012, 1.415), 0.05, 0.062), 0.07)
    body = smooth_min(torso, _skirt(p, it), 0.07)
    held = "right" if it.side > 0 else "left"
    shoulder, elbow, wrist = (it.joints[NAMES.index(f"{held}_{name}")] for name in ("shoulder", "elbow", "wrist"))
    body = add(body, p, (shoulder + elbow) / 2, 0.3, 0.14, lambda q: limb(q, shoulder, elbow, 0.058, 0.052))
    body = add(body, p, (elbow + wrist) / 2, 0.3, 0.10, lambda q: limb(q, elbow, wrist, 0.052, 0.036))
    # The bent knee presses through the dress.
    s = -it.side
    hip, knee, ankle = np.array([[s * 0.09, -0.02, 0.90], [s * 0.115, -0.165, 0.50], [s * 0.135, -0.03, 0.10]])
    body = add(body, p, (hip + knee) / 2, 0.36, 0.07, lambda q: limb(q, hip, knee, 0.10, 0.066))
    return add(body, p, (knee + ankle) / 2, 0.36, 0.08, lambda q: limb(q, knee, ankle, 0.066, 0.06))


def _skirt(p: Point, it: Draped) -> Dual:
    x, y, z = p
    low = ease((1.06 - z) * (1 / 0.3))
    radius = 0.128 * it.stout + low * 0.06 + ease((0.75 - z) * (1 / 0.72)) * 0.055
    wall = (length(x, y * 1.16, z * 0.0 + 0.01) - radius) * 0.93
    return smooth_max(wall, soft_abs(z - 0.55, 0.002) - 0.55, 0.05)


def _cloth(p: Point, it: Draped, carver: Carver, detail: float) -> Dual:
    """The height of dress and mantle over the body.

    Folds depend only on the direction from the body's axis and on the height, so none overhangs another.
    """
    s, rho = it.side, length(p[0], p[1], p[2] * 0.0 + 0.02) * (1 / 0.2)
    x, y, z = p[0] / rho, p[1] / rho, p[2]
    knee = length(x + s * 0.11, y + 0.17, (z - 0.55) * 0.45)
    loose = ease((knee - 0.05) * (1 / 0.10)) * 0.85 + 0.15  # cloth is tight over the knee
    # Folds on the arm under the mantle are low: they must not close the gap between arm and hip.
    loose = loose * (1 - ease((rho * 0.2 - 0.20) * 14) * ease((z - 0.8) * 12) * 0.75)
    drift = carver.noise((x * 4, y * 4, z * 2.2), 3) * 0.5
    ends = ease((1.49 - z) * (1 / 0.06))
    if not it.mantle:
        return ends * _dress(p, loose, drift, carver, detail)
    top = z - 1.20 - x * (s * -1.35) - ease(-y * 4) * 0.05
    bottom = z - 0.40 + x * (s * 0.55)
    covers = ease(-top * (1 / 0.05)) * ease(bottom * (1 / 0.05)) * ends

    def mantle(q: tuple[Dual, ...]) -> Dual:
        u, v, w, rise, give, bend = q
        across = w * 15 + u * (s * 11) + u.square() * 55 + v * 5 + bend
        wraps = carver.folds(across * 0.85, u * (s * -7) + w * 5 + v * 4, 11)
        rolled = ease(1 - soft_abs(rise + 0.05, 0.012) * (1 / 0.055)) * 0.014
        return wraps * (0.034 * detail) * (give * 0.75 + 0.25) + 0.018 + rolled

    def dress(q: tuple[Dual, ...]) -> Dual:
        u, v, w, give, bend = q
        return _dress((u, v, w), give, bend, carver, detail)

    under = (1 - covers) * ends
    return masked(under, (x, y, z, loose, drift), dress) + masked(covers, (x, y, z, top, loose, drift), mantle)


def _dress(p: Point, loose: Dual, drift: Dual, carver: Carver, detail: float) -> Dual:
    """A dress that is belted and falls over its belt; above, folds hang from the shoulders like chains."""
    x, y, z = p

    def skirt(q: tuple[Dual, ...]) -> Dual:
        x, y, z, give, bend = q
        falls = ease((1.0 - z) * (1 / 0.8)) * 0.030 + 0.012
        u, v = x * 15 + bend, y * 15 + bend
        hanging = soft_abs(carver.noise((u, v, z * 1.1), 4), 0.05) * 1.6
        fine = soft_abs(carver.noise((u * 2.3, v * 2.3, z * 2.6), 5), 0.06) * 0.5
        return (hanging + fine) * falls * give * detail

    def blouse(q: tuple[Dual, ...]) -> Dual:
        x, y, z, bend = q
        across = (z - 1.2) * 17 + x.square() * -150 + bend
        chains = carver.folds(across, x * 7 + y * 4, 7) * 0.016
        pleats = soft_abs(carver.noise((x * 26, y * 14, z * 3), 9), 0.06) * 0.014
        return (chains * ease((0.09 - soft_abs(x, 0.02)) * (1 / 0.08)) + pleats) * detail

    def falling(q: Point) -> Dual:
        x, y, z = q
        return ease((z - 0.93 - carver.noise((x * 9, y * 9, z), 10) * 0.03) * (1 / 0.035)) * 0.018

    above = ease((z - 1.03) * (1 / 0.05))
    belt = ease(1 - soft_abs(z - 1.075, 0.004) * (1 / 0.03)) * -0.012
    over = masked(ease((1.09 - z) * (1 / 0.06)) * ease((z - 0.86) * (1 / 0.03)), p, falling)
    return masked(1 - above, (x, y, z, loose, drift), skirt) + masked(above, (x, y, z, drift), blouse) + belt + over


def _bare(body: Dual, p: Point, it: Draped) -> Dual:
    """Neck, arms, hands and feet."""
    body = add(
        body, p, (0, 0.01, 1.50), 0.16, 0.03, lambda q: limb(q, (0, 0.022, 1.42), (0, 0.008, 1.60), 0.060, 0.052)
    )
    m = (soft_abs(p[0], 0.004), p[1], p[2])
    body = add(body, m, (0.1, -0.2, 0.07), 0.2, 0.02, lambda q: smooth_min(
        ellipsoid(q, (0.095, -0.20, 0.085), (0.046, 0.105, 0.042)),
        ellipsoid(q, (0.082, -0.285, 0.075), (0.020, 0.035, 0.020)), 0.02))  # fmt: skip
    for name in ("left", "right"):
        free = (name == "left") == (it.side > 0)
        shoulder, elbow, wrist = (it.joints[NAMES.index(f"{name}_{part}")] for part in ("shoulder", "elbow", "wrist"))
        if free:
            width = 0.045
            body = add(body, p, (shoulder + elbow) / 2, 0.3, width, _rod(shoulder, elbow, 0.058, 0.043))
            belly = elbow + 0.3 * (wrist - elbow)
            body = add(body, p, (elbow + wrist) / 2, 0.25, 0.03, _rod(elbow, belly, 0.042, 0.044))
            body = add(body, p, (belly + wrist) / 2, 0.25, 0.03, _rod(belly, wrist, 0.044, 0.028))
        body = _hand(body, p, it, name)
    return body


def _rod(start: np.ndarray, end: np.ndarray, radius: float, other: float) -> Form:
    return lambda q: limb(q, start, end, radius, other)


def _hand(body: Dual, p: Point, it: Draped, name: str) -> Dual:
    wrist, fingers = (it.joints[NAMES.index(f"{name}_{part}")] for part in ("wrist", "fingers"))
    tips = it.ends[NAMES.index(f"{name}_fingers")]
    turn = it.turns[NAMES.index(f"{name}_wrist")]
    front = turn @ np.array([0.0, -1.0, 0.0])
    along = (fingers - wrist) / np.linalg.norm(fingers - wrist)
    reach = (tips - fingers) / np.linalg.norm(tips - fingers)
    inner = np.cross(along, front) * (1 if name == "left" else -1)
    spread, lengths = (1.5, 0.5, -0.5, -1.5), (0.068, 0.075, 0.070, 0.056)

    def part(q: Point) -> Dual:
        hand = smooth_min(limb(q, wrist + front * 0.008, fingers + front * 0.022, 0.024, 0.017),
                          limb(q, wrist - front * 0.008, fingers - front * 0.022, 0.024, 0.016), 0.025)  # fmt: skip
        for s, long in zip(spread, lengths, strict=True):
            # Fingers lie side by side, with grooves but no gaps between them.
            root = fingers + front * (0.0195 * s)
            middle = root + 0.5 * long * reach
            tip = middle + 0.5 * long * (reach + inner * -0.25)
            finger = smooth_min(limb(q, root, middle, 0.0125, 0.0115), limb(q, middle, tip, 0.0115, 0.0105), 0.006)
            hand = smooth_min(hand, finger, 0.013)
        root = wrist + along * 0.025 + front * 0.022
        bend = root + 0.042 * (0.62 * along + 0.78 * front)
        thumb = smooth_min(
            limb(q, root, bend, 0.019, 0.013),
            limb(q, bend, bend + 0.032 * (0.75 * along + 0.66 * front), 0.013, 0.011),
            0.005,
        )
        return smooth_min(hand, thumb, 0.012)

    return add(body, p, (wrist + tips) / 2, 0.14, 0.02, part)


def _plinth(body: Dual, at: Point, it: Draped) -> Dual:
    q = moved(at, (0, -0.02, 0.0))

    def part(p: Point) -> Dual:
        x, y, z = moved(p, (0, -0.02, 0.0))
        if it.square:
            base = smooth_min(
                box((x, y, z - 0.0), (0.31, 0.31, 0.045), 0.012), box((x, y, z + 0.07), (0.35, 0.35, 0.05), 0.015), 0.02
            )
            return base
        rho = length(x, y)
        base = smooth_min(disc(rho, z, 0.33, 0.045, 0.012), ring(rho, z, 0.335, -0.03, 0.028), 0.015)
        return smooth_min(base, disc(rho, z + 0.075, 0.38, 0.04, 0.012), 0.015)

    return add(body, q, (0, 0, 0), 0.55, 0.02, lambda p: part(shifted(p, (0, -0.02, 0.0))))
