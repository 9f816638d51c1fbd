"""Poses of the humanoids: degrees of freedom with their limits, twelve key poses, and random poses near them."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians

import numpy as np

from .builds import Build
from .skeleton import ENDS, NAMES, PARENTS, REST, forward, rotation_about

X, Y, Z = np.eye(3)
_ARM = (ENDS[NAMES.index("left_shoulder")] - REST[NAMES.index("left_shoulder")]) / 0.285
_BEND = np.cross(_ARM, -Y)  # turns the forearm to the front
# Name: (joint, axis at rest, lowest, highest in degrees); the order of one joint's angles is that of its rotations.
_CENTRAL = {
    "lean": ("pelvis", X, -30, 60),
    "tip": ("pelvis", Y, -20, 20),
    "spine_bend": ("spine", X, -15, 35),
    "spine_side": ("spine", Y, -18, 18),
    "spine_twist": ("spine", Z, -22, 22),
    "chest_bend": ("chest", X, -12, 25),
    "chest_twist": ("chest", Z, -20, 20),
    "neck_nod": ("neck", X, -20, 25),
    "head_nod": ("head", X, -15, 20),
    "head_tilt": ("head", Y, -15, 15),
    "head_turn": ("head", Z, -45, 45),
}
_LEFT = {
    "shrug": ("clavicle", -Y, -5, 25),
    "arm_twist": ("shoulder", _ARM, -50, 60),
    "arm_raise": ("shoulder", -Y, -42, 110),
    "arm_swing": ("shoulder", -X, -45, 130),
    "elbow": ("elbow", _BEND, 0, 130),
    "forearm_twist": ("elbow", _ARM, -50, 50),
    "wrist": ("wrist", -Y, -45, 45),
    "curl": ("fingers", Y, -5, 70),
    "leg_twist": ("hip", Z, -20, 35),
    "leg_out": ("hip", -Y, -10, 40),
    "leg_swing": ("hip", -X, -25, 100),
    "knee": ("knee", X, 0, 120),
    "foot": ("ankle", X, -25, 40),
    "toes": ("toes", -X, -10, 40),
}


def _freedoms() -> dict[str, tuple[int, np.ndarray, float, float]]:
    freedoms: dict[str, tuple[int, np.ndarray, float, float]] = {
        name: (NAMES.index(joint), axis, low, high) for name, (joint, axis, low, high) in _CENTRAL.items()
    }
    for side, mirror in (("left", np.ones(3)), ("right", np.array([1, -1, -1]))):  # an axis is a pseudo-vector
        for name, (joint, axis, low, high) in _LEFT.items():
            freedoms[f"{side}_{name}"] = (NAMES.index(f"{side}_{joint}"), mirror * axis, low, high)
    return freedoms


FREEDOMS = _freedoms()


def _key(both: dict[str, float] | None = None, **angles: float) -> dict[str, float]:
    pose = {f"{side}_{name}": angle for name, angle in (both or {}).items() for side in ("left", "right")}
    return pose | angles


KEYS = {
    "walk": _key(
        {"arm_raise": -32, "curl": 25, "elbow": 18},
        left_arm_swing=24,
        right_arm_swing=-20,
        left_leg_swing=-16,
        right_leg_swing=26,
        left_knee=16,
        right_knee=10,
        left_foot=6,
        right_foot=-8,
        left_toes=25,
        chest_twist=-8,
    ),
    "arms_up": _key({"arm_raise": 88, "shrug": 22, "elbow": 14, "curl": 8, "leg_out": 8}, head_nod=-14, chest_bend=-8),
    "sit": _key(
        {"leg_swing": 86, "knee": 86, "arm_raise": -26, "arm_swing": 28, "elbow": 42, "leg_out": 8, "curl": 20}
    ),
    "run": _key(
        {"arm_raise": -28, "elbow": 92, "curl": 60},
        left_arm_swing=44,
        right_arm_swing=-42,
        left_leg_swing=-20,
        right_leg_swing=66,
        left_knee=44,
        right_knee=82,
        left_foot=26,
        lean=10,
        chest_twist=-14,
    ),
    "wave": _key(
        {"curl": 12},
        left_arm_raise=62,
        left_elbow=62,
        left_arm_twist=-40,
        left_shrug=12,
        right_arm_raise=-32,
        right_elbow=10,
        head_turn=18,
        head_tilt=6,
        right_leg_out=6,
    ),
    "squat": _key(
        {"leg_swing": 92, "knee": 112, "foot": -24, "leg_out": 24, "arm_raise": 0, "arm_swing": 70, "leg_twist": 15},
        lean=24,
        spine_bend=14,
        head_nod=-14,
    ),
    "kick": _key(
        {"curl": 45, "elbow": 50},
        right_leg_swing=92,
        right_knee=10,
        right_foot=24,
        left_knee=10,
        left_arm_raise=20,
        left_arm_swing=42,
        right_arm_raise=10,
        right_arm_swing=-30,
        lean=-14,
        chest_twist=16,
    ),
    "lunge": _key(
        {"arm_raise": 38, "curl": 4},
        left_leg_swing=72,
        left_knee=74,
        right_leg_swing=-22,
        right_knee=20,
        right_foot=20,
        right_toes=30,
        left_leg_out=6,
        right_leg_out=8,
        head_turn=24,
    ),
    "throw": _key(
        {"leg_out": 14, "curl": 40},
        right_arm_raise=50,
        right_arm_swing=-20,
        right_elbow=90,
        right_arm_twist=-30,
        left_arm_raise=25,
        left_arm_swing=50,
        chest_twist=-18,
        spine_twist=-16,
        left_leg_swing=22,
        right_knee=18,
    ),
    "bow": _key(
        {"arm_raise": -30, "arm_swing": 24, "elbow": 14, "curl": 15, "leg_swing": 42},
        lean=40,
        spine_bend=22,
        chest_bend=10,
        neck_nod=10,
    ),
    "balance": _key(
        {"arm_raise": 42, "curl": 0},
        left_leg_swing=55,
        left_knee=105,
        left_leg_out=28,
        left_leg_twist=30,
        left_foot=30,
        spine_side=4,
    ),
    "guard": _key(
        {"elbow": 112, "curl": 70, "arm_raise": -26, "arm_swing": 38, "knee": 18, "leg_out": 8},
        left_leg_swing=24,
        right_leg_swing=-4,
        right_foot=6,
        left_arm_swing=56,
        left_elbow=92,
        chest_bend=8,
    ),
}
"""Angles in degrees by name; the others are those of the rest pose."""


def bend_limits(builds: Sequence[Build]) -> dict[str, float]:
    """How far knees and elbows bend before the flesh of one of these builds touches itself, in degrees.

    Measured: thick short limbs touch earlier, forearms earlier than calves, and earlier still when twisted.
    """
    limits: dict[str, float] = {}
    for joint, most, fall, muscle, length in (("elbow", 106, 80, 0.1, "arms"), ("knee", 110, 70, 0.05, "legs")):
        thick = [
            (1 + 0.13 * b.bulk) * (1 + muscle * b.muscle) / (1 + 0.1 * getattr(b, length)) for b in (Build(), *builds)
        ]
        limits |= {f"{side}_{joint}": most - fall * (max(thick) - 1) for side in ("left", "right")}
    return limits


def draw_pose(
    name: str, rng: np.random.Generator, jitter: float = 6.0, builds: Sequence[Build] = (Build(),)
) -> np.ndarray:
    """The joint rotations (joints, 3, 3) of a pose near a key pose, perhaps mirrored, within the limits.

    Every angle gets Gaussian noise of ``jitter`` degrees. Knees and elbows bend at most as far as the flesh of all
    ``builds`` allows. If bones come too close, the pose is moved back towards rest.
    """
    limits = bend_limits(builds)
    angles = dict(KEYS[name])
    if rng.random() < 0.5:
        angles = {_mirrored(k): -v if k.endswith(("twist", "turn", "side", "tilt", "tip")) and k in _CENTRAL else v
                  for k, v in angles.items()}  # fmt: skip
    for freedom, (_, _, low, high) in FREEDOMS.items():
        angle = angles.get(freedom, 0.0) + jitter * rng.normal() * (0.5 if freedom in _CENTRAL else 1.0)
        angles[freedom] = float(np.clip(angle, low, min(high, limits.get(freedom, high))))
    for _ in range(12):
        rotations = joint_rotations(angles)
        if clearance(rotations, builds) > 0:
            break
        angles = {freedom: 0.85 * angle for freedom, angle in angles.items()}
    return rotations


def _mirrored(name: str) -> str:
    if name.startswith("left_"):
        return "right_" + name[5:]
    return "left_" + name[6:] if name.startswith("right_") else name


def joint_rotations(angles: dict[str, float]) -> np.ndarray:
    """Degrees by name of the freedom -> (joints, 3, 3) array."""
    rotations = np.tile(np.eye(3), (len(NAMES), 1, 1))
    for freedom, (joint, axis, _, _) in FREEDOMS.items():
        if freedom in angles:
            rotations[joint] = rotation_about(axis, radians(angles[freedom])) @ rotations[joint]
    return rotations


_RADII = {"pelvis": 0.13, "spine": 0.11, "chest": 0.12, "neck": 0.06, "head": 0.1, "clavicle": 0.06, "shoulder": 0.05,
          "elbow": 0.042, "wrist": 0.034, "fingers": 0.034, "hip": 0.075, "knee": 0.055, "ankle": 0.045,
          "toes": 0.04}  # fmt: skip


def clearance(rotations: np.ndarray, builds: Sequence[Build] = (Build(),)) -> float:
    """The least gap between two bones of the template that are not neighbours, in metres.

    Bones are as thick as in the thickest of the builds, and at least as thick as in the template.
    """
    thick = max(
        (1 + 0.13 * max(b.bulk, 0)) * (1 + 0.12 * max(b.hips, 0)) * (1 + 0.1 * max(b.muscle, 0)) for b in builds
    )
    turns, shifts = forward(REST, rotations)
    t = np.linspace(0, 1, 7)[:, None, None]
    points = REST + t * (ENDS - REST)
    posed = np.einsum("jab,tjb->tja", turns, points) + shifts
    radii = thick * np.array([_RADII[name.split("_")[-1]] for name in NAMES])

    def gaps(p: np.ndarray) -> np.ndarray:
        d = np.linalg.norm(p[:, None, :, None] - p[None, :, None, :], axis=-1).min(axis=(0, 1))
        return d - radii[:, None] - radii[None]

    related = gaps(points) < 0.01  # neighbours, and bones that are close at rest
    for j, parent in enumerate(PARENTS):
        if parent >= 0:
            related[j, parent] = related[parent, j] = True
    return float(np.where(related, np.inf, gaps(posed)).min())
