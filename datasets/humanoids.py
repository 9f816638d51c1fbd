"""Human bodies with a skeleton, in many builds and poses, all with one set of faces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from itertools import count
from math import pi
from typing import TYPE_CHECKING, Literal

import numpy as np

from bench import PoseTransfer, Shape, ShapePair, generator, register

from .figures.bodies import skin, template
from .figures.builds import Build, draw_build, shaped
from .figures.characters import CHARACTERS, STOUT
from .figures.landmarks import JointLandmarks
from .figures.poses import KEYS, draw_pose
from .figures.skeleton import forward, rotation_about
from .figures.skinning import dual_quaternion_skinning

if TYPE_CHECKING:
    from trimesh import Trimesh

_MARKS = {
    "head_top": (0, 0, 1.8), "nose": (0, -0.15, 1.612), "chin": (0, -0.12, 1.545), "navel": (0, -0.12, 1.07),
    "breastbone": (0, -0.15, 1.36), "nape": (0, 0.12, 1.5), "small_of_back": (0, 0.15, 1.1), "crotch": (0, 0.0, 0.84),
    "left_ear": (0.12, 0.01, 1.64), "left_shoulder": (0.21, 0.01, 1.53), "left_elbow": (0.42, 0.06, 1.26),
    "left_wrist": (0.575, 0.0, 1.11), "left_hip": (0.25, 0.0, 0.95), "left_knee": (0.12, -0.09, 0.49),
    "left_ankle": (0.2, 0.02, 0.085), "left_heel": (0.142, 0.12, 0.02), "left_toe": (0.15, -0.23, 0.02),
    "left_hand": (0.70, -0.015, 0.93), "left_armpit": (0.19, 0.0, 1.33),
}  # fmt: skip


KINDS = ("body", *CHARACTERS)  # of characters


@register("dataset", requires=("open3d", "scipy", "skimage", "trimesh"))
@dataclass(frozen=True)
class Humanoids:
    """Human bodies: 23 joints, nine measures of build, twelve key poses with variations; the same faces for all.

    A smooth union of round cones and ellipsoids is meshed once as the template (7,002 vertices). Builds stretch its
    bones and thicken its flesh; poses rotate its joints within their limits, skinned with heat weights by dual
    quaternions, since blended matrices would shrink bent elbows and knees. Hence vertex i of any body in any pose
    corresponds to vertex i of any other. Metres; z is up, a body at rest faces -y.
    """

    jitter: float = 6.0  # deviation of the joint angles from the key pose, in degrees
    variety: float = 1.0  # deviation of builds from the mean: 0 is one body for all, 1 the full range
    characters: Literal["all", "body", "robot", "skeleton", "stout"] = "all"  # of pose transfer: in turn, or one kind

    def __post_init__(self) -> None:
        if not 0 <= self.jitter <= 15:
            raise ValueError(f"jitter: expected 0 to 15 degrees, got {self.jitter}")
        if not 0 <= self.variety <= 1:
            raise ValueError(f"variety: expected 0 to 1, got {self.variety}")
        if self.characters not in ("all", *KINDS):
            raise ValueError(f"characters: expected all, {', '.join(KINDS)}; got {self.characters!r}")

    def shapes(self, split: str) -> Iterator[Shape]:
        """Posed bodies, each with its own build, rotated at random about the vertical."""
        for index in count():
            rng = generator("humanoids", split, index)
            key = self._key(index)
            build = draw_build(rng, self.variety)
            pose = draw_pose(key, rng, self.jitter, [build])
            pose[0] = rotation_about(np.array([0, 0, 1.0]), rng.uniform(0, 2 * pi)) @ pose[0]
            yield _shape(f"humanoids-{split}-{index:03d}-{key}", build, pose, key)

    def pairs(self, split: str) -> Iterator[ShapePair]:
        """Even: one body at rest -> posed. Odd: a posed body -> another body in another pose."""
        for index in count():
            rng = generator("humanoids pairs", split, index)
            key, id = self._key(index), f"humanoids-{split}-{index:03d}"
            build = draw_build(rng, self.variety)
            pose = draw_pose(key, rng, self.jitter, [build])
            if index % 2 == 0:
                source = _shape(f"{id}-source", build, None, "rest")
            else:
                other = list(KEYS)[int(rng.integers(len(KEYS)))]
                body = draw_build(rng, self.variety)
                source = _shape(f"{id}-source", body, draw_pose(other, rng, self.jitter, [body]), other)
            yield ShapePair(id, source, _shape(f"{id}-target", build, pose, key), Landmarks())

    def transfers(self, split: str) -> Iterator[PoseTransfer]:
        """Problems of pose transfer: a body of another build shows the pose that a character has to take.

        Characters are another body on the template's faces, a robot of rigid parts, a skeleton of thin bones, and a
        stout body with its own mesh.
        """
        for index in count():
            rng = generator("humanoids transfers", split, index)
            key, id = self._key(index), f"humanoids-{split}-{index:03d}"
            kind = KINDS[(index + index // len(KEYS)) % len(KINDS)] if self.characters == "all" else self.characters
            seen, other = draw_build(rng, self.variety), draw_build(rng, self.variety)
            pose = draw_pose(key, rng, self.jitter, [Build(), seen, STOUT if kind == "stout" else other])
            character = partial(posed_body, other) if kind == "body" else partial(posed_character, kind)
            yield PoseTransfer(
                id,
                _shape(f"{id}-template", Build(), None, "rest"),
                _shape(f"{id}-template-posed", Build(), pose, key),
                _shape(f"{id}-target", seen, pose, key),
                _character(f"{id}-character", kind, character, None),
                _character(f"{id}-character-posed", kind, character, pose),
                JointLandmarks(partial(posed_body, Build(), None), partial(character, None)),
            )

    def _key(self, index: int) -> str:
        return list(KEYS)[index % len(KEYS)]


def _shape(id: str, build: Build, pose: np.ndarray | None, key: str) -> Shape:
    info = {"genus": 0, "pose": key, "build": build._asdict(), "symmetry": "none"}
    return Shape(
        id,
        lambda: posed_body(build, pose)[0],
        tags=(key,),
        info=info,
        exactness="mesh",
        attributes=lambda: {"weights": skin(), "joints": posed_body(build, pose)[1]},
    )


def _character(id: str, kind: str, figure: Callable, pose: np.ndarray | None) -> Shape:
    return Shape(id, lambda: figure(pose)[0], tags=(kind,), info={"character": kind}, exactness="mesh")


def posed_body(build: Build, pose: np.ndarray | None) -> tuple[Trimesh, np.ndarray]:
    """The mesh of a body, its lowest point at z = 0, and the positions of its joints (joints, 3)."""
    V, F = template()
    return _posed(*shaped(V, skin(), build), F, skin(), pose)


def posed_character(kind: str, pose: np.ndarray | None) -> tuple[Trimesh, np.ndarray]:
    """The mesh of a robot, a skeleton or a stout body, its lowest point at z = 0, and its joints (joints, 3)."""
    V, F, W, joints = CHARACTERS[kind]()
    return _posed(V, joints, F, W, pose)


def _posed(
    V: np.ndarray, joints: np.ndarray, F: np.ndarray, W: np.ndarray, pose: np.ndarray | None
) -> tuple[Trimesh, np.ndarray]:
    from trimesh import Trimesh

    if pose is not None:
        turns, shifts = forward(joints, pose)
        V = dual_quaternion_skinning(V, W, turns, shifts)
        joints = np.einsum("jab,jb->ja", turns, joints) + shifts
    ground = np.array([0, 0, V[:, 2].min()])
    return Trimesh(V - ground, F, process=False), joints - ground


class Landmarks(Mapping):
    """Named vertices, the same in all bodies; found on first use, so that pairs cost nothing."""

    def __getitem__(self, name: str) -> int:
        return _landmarks()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(_landmarks())

    def __len__(self) -> int:
        return len(_landmarks())


@cache
def _landmarks() -> dict[str, int]:
    V, _ = template()
    marks = {name: np.array(at, float) for name, at in _MARKS.items()}
    marks |= {"right" + name[4:]: at * (-1, 1, 1) for name, at in marks.items() if name.startswith("left")}
    return {name: int(((V - at) ** 2).sum(axis=1).argmin()) for name, at in marks.items()}
