"""The skeleton of the humanoids: joints, their rest positions in metres, and forward kinematics.

The body stands in an A-pose, z up, facing -y, its left side at +x. Each joint carries the bone that leaves it.
"""

from __future__ import annotations

from math import cos, radians, sin

import numpy as np

# Name: (parent, position of the joint, end of its bone); of the limbs the left side, at +x.
_ARM = np.array([cos(radians(42)), 0.0, -sin(radians(42))])  # direction of the arms in the A-pose
_FRONT = np.array([0.0, -1.0, 0.0])
PALM = np.cross(_ARM, _FRONT)  # normal of the back of the hand (towards outside and up) is -PALM or PALM by its sign
_SHOULDER = np.array([0.18, 0.01, 1.435])
_ELBOW = _SHOULDER + 0.285 * _ARM
_WRIST = _ELBOW + 0.25 * _ARM + 0.012 * _FRONT
_KNUCKLES = _WRIST + 0.088 * _ARM
_FINGERTIPS = _KNUCKLES + 0.08 * _ARM

_CENTRAL = {
    "pelvis": (None, (0, 0.0, 0.96), (0, 0.0, 1.06)),
    "spine": ("pelvis", (0, 0.0, 1.06), (0, -0.005, 1.22)),
    "chest": ("spine", (0, -0.005, 1.22), (0, 0.015, 1.47)),
    "neck": ("chest", (0, 0.02, 1.48), (0, 0.0, 1.565)),
    "head": ("neck", (0, 0.0, 1.565), (0, -0.015, 1.76)),
}
_LEFT = {
    "clavicle": ("chest", (0.03, 0.0, 1.44), _SHOULDER),
    "shoulder": ("clavicle", _SHOULDER, _ELBOW),
    "elbow": ("shoulder", _ELBOW, _WRIST),
    "wrist": ("elbow", _WRIST, _KNUCKLES),
    "fingers": ("wrist", _KNUCKLES, _FINGERTIPS),
    "hip": ("pelvis", (0.092, 0.0, 0.925), (0.122, -0.012, 0.49)),
    "knee": ("hip", (0.122, -0.012, 0.49), (0.142, 0.02, 0.085)),
    "ankle": ("knee", (0.142, 0.02, 0.085), (0.158, -0.105, 0.025)),
    "toes": ("ankle", (0.158, -0.105, 0.025), (0.164, -0.175, 0.02)),
}


def _mirrored(point: object) -> np.ndarray:
    return np.asarray(point, dtype=np.float64) * (-1, 1, 1)


def _joints() -> dict[str, tuple[str | None, np.ndarray, np.ndarray]]:
    joints = {name: (parent, np.array(at, float), np.array(end, float)) for name, (parent, at, end) in _CENTRAL.items()}
    for side, place in (("left", np.array), ("right", _mirrored)):
        for name, (parent, at, end) in _LEFT.items():
            above = parent if parent in _CENTRAL else f"{side}_{parent}"
            joints[f"{side}_{name}"] = (above, place(at).astype(float), place(end).astype(float))
    return joints


_JOINTS = _joints()
NAMES = tuple(_JOINTS)
"""The 23 joints, parents before children."""
PARENTS = tuple(-1 if parent is None else NAMES.index(parent) for parent, _, _ in _JOINTS.values())
REST = np.array([at for _, at, _ in _JOINTS.values()])
"""(joints, 3) array: where the joints are in the rest pose."""
ENDS = np.array([end for _, _, end in _JOINTS.values()])
"""(joints, 3) array: where their bones end."""


def rotation_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """The (3, 3) rotation by ``angle`` in radians about ``axis`` (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + sin(angle) * cross + (1 - cos(angle)) * (cross @ cross)


def forward(joints: np.ndarray, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pose the skeleton.

    Parameters
    ----------
    joints : (j, 3) array, the joints at rest
    rotations : (j, 3, 3) array, each joint's rotation in the axes of the rest pose, before those of its parents

    Returns
    -------
    turns : (j, 3, 3) array
    shifts : (j, 3) array
        A point that is fixed to joint j goes to ``turns[j] @ x + shifts[j]``.
    """
    turns, places = np.empty((len(joints), 3, 3)), np.empty((len(joints), 3))
    for j, parent in enumerate(PARENTS):
        if parent < 0:
            turns[j], places[j] = rotations[j], joints[j]
        else:
            turns[j] = turns[parent] @ rotations[j]
            places[j] = places[parent] + turns[parent] @ (joints[j] - joints[parent])
    return turns, places - np.einsum("jab,jb->ja", turns, joints)
