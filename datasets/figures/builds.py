"""Builds of the humanoids: how tall, broad, heavy and muscular a body is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .skeleton import ENDS, NAMES, PARENTS, REST


class Build(NamedTuple):
    """Measures of a body, 0 for the template; about -1 to 1."""

    height: float = 0.0
    legs: float = 0.0  # their length
    arms: float = 0.0
    bulk: float = 0.0  # thickness of trunk and limbs
    shoulders: float = 0.0  # their width
    hips: float = 0.0
    belly: float = 0.0  # 0 or more is fat
    muscle: float = 0.0
    head: float = 0.0  # its size


def draw_build(rng: np.random.Generator, variety: float = 1.0) -> Build:
    """A build at random; ``variety`` scales it."""
    values = variety * np.clip(rng.normal(0, 0.55, size=len(Build._fields)), -1, 1)
    return Build(*(round(float(v), 6) for v in values))


def shaped(V: np.ndarray, W: np.ndarray, build: Build) -> tuple[np.ndarray, np.ndarray]:
    """The template's vertices (v, 3) and joints (j, 3) in this build: scaled bones, blended by weights ``W``."""
    scales = _scales(build)
    joints = REST.copy()
    for j, parent in enumerate(PARENTS):
        if parent >= 0:
            joints[j] = joints[parent] + scales[parent] @ (REST[j] - REST[parent])
    swollen = V + _flesh(V, build)
    blended = np.einsum("vj,jab->vab", W, scales)
    shifts = W @ (joints - np.einsum("jab,jb->ja", scales, REST))
    size = 1 + 0.09 * build.height
    return size * (np.einsum("vab,vb->va", blended, swollen) + shifts), size * joints


def _scales(build: Build) -> np.ndarray:
    """The stretch of each bone, along it and across, as (joints, 3, 3) symmetric matrices."""
    thick = 1 + 0.13 * build.bulk
    trunk = np.diag([thick * (1 + 0.03 * build.shoulders), thick * (1 + 0.03 * build.belly), 1 + 0.03 * build.arms])
    scales = {
        "pelvis": np.diag([thick * (1 + 0.12 * build.hips), thick, 1.0]),
        "spine": trunk,
        "chest": np.diag([thick * (1 + 0.1 * build.shoulders), thick * (1 + 0.06 * build.muscle), 1.0]),
        "neck": np.diag([thick * (1 + 0.08 * build.muscle)] * 2 + [1 + 0.06 * build.arms]),
        "head": np.eye(3) * (1 + 0.08 * build.head),
    }
    muscle = 1 + 0.1 * build.muscle
    limbs = {"clavicle": (1 + 0.12 * build.shoulders, thick), "shoulder": (1 + 0.1 * build.arms, thick * muscle),
             "elbow": (1 + 0.1 * build.arms, thick * muscle), "wrist": (1 + 0.05 * build.arms,) * 2,
             "fingers": (1 + 0.05 * build.arms,) * 2, "hip": (1 + 0.1 * build.legs, thick * (1 + 0.05 * build.muscle)),
             "knee": (1 + 0.1 * build.legs, thick * (1 + 0.05 * build.muscle)), "ankle": (1 + 0.05 * build.legs,) * 2,
             "toes": (1 + 0.05 * build.legs,) * 2}  # fmt: skip
    result = []
    for name, joint, end in zip(NAMES, REST, ENDS, strict=True):
        if name in scales:
            result.append(scales[name])
            continue
        along, across = limbs[name.split("_")[1]]
        axis = (end - joint) / np.linalg.norm(end - joint)
        result.append(across * np.eye(3) + (along - across) * np.outer(axis, axis))
    return np.array(result)


def _flesh(V: np.ndarray, build: Build) -> np.ndarray:
    """The displacements (v, 3) by soft tissue, in metres."""
    x, y, z = V.T
    both = np.abs(x)

    def bump(center: tuple[float, float, float], widths: tuple[float, float, float]) -> np.ndarray:
        parts = zip((both, y, z), center, widths, strict=True)
        return np.exp(-sum(((value - at) / width) ** 2 for value, at, width in parts))

    out = np.zeros_like(V)
    belly = bump((0, -0.11, 1.06), (0.13, 0.1, 0.12))
    out[:, 1] -= (0.075 if build.belly > 0 else 0.02) * build.belly * belly
    out[:, 2] -= 0.02 * max(build.belly, 0) * belly
    flanks = bump((0.14, 0.0, 1.06), (0.07, 0.12, 0.1))
    out[:, 0] += np.sign(x) * 0.03 * build.belly * flanks
    out[:, 1] += 0.022 * build.hips * bump((0.07, 0.13, 0.92), (0.09, 0.06, 0.09))
    out[:, 1] -= 0.016 * build.muscle * bump((0.08, -0.09, 1.34), (0.07, 0.06, 0.06))
    out[:, 1] += 0.015 * build.muscle * bump((0.13, 0.06, 0.36), (0.06, 0.05, 0.09))
    return out
