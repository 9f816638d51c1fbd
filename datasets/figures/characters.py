"""Characters with their own meshes: a robot, a skeleton and a stout body, on the joints of the humanoids.

The parts of robot and skeleton are rigid: each follows one bone, so posing them is exact. The stout body is a new mesh
of a body with its own build; each vertex has the weights of its place on the template.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .bodies import skin, template, thinned
from .builds import Build, shaped
from .skeleton import ENDS, NAMES, REST

if TYPE_CHECKING:
    from trimesh import Trimesh

STOUT = Build(height=-0.9, legs=-0.7, bulk=1.0, hips=0.6, belly=1.0, head=0.5)
STOUT_FACES = 11_000
GRAIN = 2.0**-17  # metres: rounding makes the input of the thinning the same on every processor


class Character(NamedTuple):
    """A figure at rest."""

    vertices: np.ndarray  # (v, 3) metres
    faces: np.ndarray  # (f, 3)
    weights: np.ndarray  # (v, joints), each row adds up to 1
    joints: np.ndarray  # (joints, 3)


class _Parts:
    """Rigid parts, each tied to a bone."""

    def __init__(self) -> None:
        self._meshes: list[Trimesh] = []
        self._bones: list[int] = []

    def add(self, mesh: Trimesh, bone: int) -> None:
        self._meshes.append(mesh)
        self._bones.append(bone)

    def character(self) -> Character:
        """All parts as one mesh; they may overlap, each is closed."""
        counts = [len(mesh.vertices) for mesh in self._meshes]
        starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        faces = [mesh.faces + start for mesh, start in zip(self._meshes, starts, strict=True)]
        weights = np.eye(len(NAMES))[np.repeat(self._bones, counts)]
        vertices = np.concatenate([mesh.vertices for mesh in self._meshes])
        return Character(vertices, np.concatenate(faces).astype(np.int64), weights, REST.copy())


def _frame_along(axis: np.ndarray) -> np.ndarray:
    """A rotation (3, 3) that takes z to ``axis`` and x as near to the world's x as possible."""
    z = axis / np.linalg.norm(axis)
    x = np.array([1.0, 0, 0]) if abs(z[0]) < 0.9 else np.array([0, -1.0, 0])
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _placed(mesh: Trimesh, start: np.ndarray, end: np.ndarray) -> Trimesh:
    """A mesh around the origin along z, moved between two points."""
    mesh.vertices = np.asarray(mesh.vertices) @ _frame_along(end - start).T + (start + end) / 2
    return mesh


def _block(size: tuple[float, float, float], bevel: float) -> Trimesh:
    """A box with bevelled corners, divided finely enough for cotangent weights."""
    from trimesh import Trimesh

    from bench.geometry.subdivision import divided

    half = np.array(size) / 2
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    corners = np.concatenate([signs * (half - bevel * (1 - np.eye(3)[k])) for k in range(3)])
    hull = Trimesh(corners, process=False).convex_hull
    return Trimesh(*divided(np.array(hull.vertices), np.array(hull.faces), 2), process=False)


def _ball(centre: np.ndarray, radii: float | tuple[float, float, float], subdivisions: int = 2) -> Trimesh:
    from trimesh.creation import icosphere

    ball = icosphere(subdivisions=subdivisions)
    ball.vertices = np.asarray(ball.vertices) * radii + centre
    return ball


def _shaft(start: np.ndarray, end: np.ndarray, radius: Callable[[np.ndarray], np.ndarray], rings: int) -> Trimesh:
    """A round bar whose ``radius`` is a function of the position, 0 at ``start`` and 1 at ``end``."""
    from trimesh import Trimesh

    around = 12
    place = np.linspace(0, 1, rings)
    angle = 2 * np.pi * np.arange(around) / around
    wide = radius(place)[:, None]
    height = np.broadcast_to((place[:, None] - 0.5) * np.linalg.norm(end - start), (rings, around))
    sides = np.stack([wide * np.cos(angle), wide * np.sin(angle), height], axis=2).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij")
    a, b = (i * around + j).ravel(), (i * around + (j + 1) % around).ravel()
    faces = np.concatenate([np.column_stack([a, b, b + around]), np.column_stack([a, b + around, a + around])])
    caps = np.array([[0, 0, height[0, 0]], [0, 0, height[-1, 0]]])
    low, ring, top = len(sides), np.arange(around), (rings - 1) * around
    following = (ring + 1) % around
    ends = [
        np.column_stack([np.full(around, low), following, ring]),
        np.column_stack([np.full(around, low + 1), top + ring, top + following]),
    ]
    mesh = Trimesh(np.concatenate([sides, caps]), np.concatenate([faces, *ends]), process=False)
    return _placed(mesh, start, end)


def _bone(name: str) -> tuple[int, np.ndarray, np.ndarray]:
    number = NAMES.index(name)
    return number, REST[number], ENDS[number]


@cache
def robot() -> Character:
    """Bevelled blocks along the bones and balls at the joints."""
    parts = _Parts()
    blocks = {"pelvis": (0.26, 0.18, 0.14), "spine": (0.2, 0.15, 0.15), "chest": (0.32, 0.2, 0.26),
              "neck": (0.07, 0.07, 0.1), "head": (0.17, 0.2, 0.2)}  # fmt: skip
    limbs = {"clavicle": 0.075, "shoulder": 0.085, "elbow": 0.075, "wrist": 0.06, "fingers": 0.045, "hip": 0.12,
             "knee": 0.1, "ankle": 0.075, "toes": 0.07}  # fmt: skip
    for name in NAMES:
        number, start, end = _bone(name)
        if name in blocks:
            block = _block(blocks[name], 0.015)
            block.vertices = np.asarray(block.vertices) + (start + end) / 2
        else:
            width = limbs[name.split("_")[1]]
            block = _placed(_block((width, width, 0.86 * float(np.linalg.norm(end - start))), 0.15 * width), start, end)
            parts.add(_ball(start, 0.56 * width), number)
        parts.add(block, number)
    return parts.character()


@cache
def skeleton() -> Character:
    """Thin bones with knobs at their ends, a skull, ribs and a pelvis."""
    parts = _Parts()
    for name in NAMES:
        number, start, end = _bone(name)
        if name == "head":
            parts.add(_ball(start + (0, 0.0, 0.11), (0.072, 0.092, 0.085), 3), number)
            parts.add(_ball(start + (0, -0.045, 0.025), (0.045, 0.045, 0.035)), number)
            parts.add(_ball(start, 0.024), number)
        else:
            thick = 0.016 if name in ("pelvis", "spine", "chest", "neck") else 0.013
            slender = 0.8 if "fingers" in name or "toes" in name else 1.0
            radius = thick * slender
            longer = 0.3 * radius * (end - start) / np.linalg.norm(end - start)  # no joint lies on a cap
            parts.add(
                _shaft(start - longer, end + longer, partial(_widening, radius), 13),
                number,
            )
            parts.add(_ball(start, 1.9 * radius), number)
    pelvis = NAMES.index("pelvis")
    for side in (-1, 1):
        parts.add(_ball(REST[pelvis] + (0.07 * side, 0.015, 0.01), (0.06, 0.035, 0.055)), pelvis)
    chest = NAMES.index("chest")
    for level, (half, deep) in enumerate(((0.09, 0.065), (0.115, 0.08), (0.125, 0.088), (0.125, 0.088), (0.115, 0.08))):
        height = 1.43 - 0.042 * level
        parts.add(_ring((0.0, 0.0, height), half, deep, 0.0085), chest)
    parts.add(_shaft(np.array([0, -0.082, 1.45]), np.array([0, -0.086, 1.24]), lambda t: 0.012 + 0 * t, 9), chest)
    return parts.character()


def _widening(radius: float, t: np.ndarray) -> np.ndarray:
    return radius * (1 + 0.6 * np.abs(2 * t - 1) ** 4)


def _ring(centre: tuple[float, float, float], half: float, deep: float, radius: float) -> Trimesh:
    """A pair of ribs: a ring that is lower in front."""
    from trimesh.creation import torus

    ring = torus(1.0, 0.1, major_sections=28, minor_sections=8)
    x, y, z = np.asarray(ring.vertices).T
    outwards = np.hypot(x, y)
    along = np.stack([x, y]) / outwards
    wide = outwards - 1  # -0.1 to 0.1 across
    flat = along * (np.array([[half], [deep]]) + 10 * radius * wide)
    ring.vertices = np.column_stack([*flat, 10 * radius * z + 0.25 * flat[1]]) + centre
    return ring


@cache
def stout() -> Character:
    """A short, heavy body with its own mesh."""
    from trimesh import Trimesh
    from trimesh.triangles import points_to_barycentric

    from bench.geometry.mesh_surface import MeshSurface
    from bench.geometry.subdivision import divided

    V, F = template()
    body, joints = shaped(V, skin(), STOUT)
    vertices, faces = thinned(*divided(np.round(body / GRAIN) * GRAIN, F, 1), STOUT_FACES)
    at = MeshSurface(Trimesh(body, F, process=False)).project(vertices)
    corners = F[at.faces]
    shares = np.clip(points_to_barycentric(body[corners], at.points), 0, 1)
    weights = np.einsum("vk,vkj->vj", shares / shares.sum(axis=1, keepdims=True), skin()[corners])
    return Character(vertices, faces, weights, joints)


CHARACTERS: dict[str, Callable[[], Character]] = {"robot": robot, "skeleton": skeleton, "stout": stout}
"""The characters by name; each is made once."""
