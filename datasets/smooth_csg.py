"""Bodies built from rounded primitives by smooth booleans: machine parts with fillets, limbs, housings, pipes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from math import pi
from typing import Literal

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of, spread
from .common.rotations import random_rotation
from .surfaces import sdf_nodes as sdf
from .surfaces.implicit import Body, ImplicitSurface, box_of_ball
from .surfaces.sdf_nodes import Difference, Node, NodeField, Placed, Union

UPRIGHT = np.eye(3)
ALONG_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # turns the axis of a primitive from z to x


@register("dataset", requires=("scipy", "skimage", "trimesh"))
@dataclass(frozen=True)
class SmoothCsg(Family):
    """Smooth booleans of rounded primitives; exact samples, normals and closest points.

    In turn a machine part (plate or flange with bosses, ribs and holes), an organic body (limbs that grow on one
    another), a housing (a hollow body with windows) and a joint of pipes. Where bodies meet, a polynomial blend makes a
    fillet, twice continuously differentiable; its width, as a multiple of the kind's usual width, is spread evenly
    between two limits (a golden-ratio sequence): near 0.5 edges look almost sharp, near 1.5 they look melted. The genus
    is not known before the mesh is made.
    """

    kind: Literal["all", "machine", "organic", "housing", "pipes"] = "all"  # of body
    blend_low: float = 0.5  # narrowest fillets, as a multiple of the kind's usual width
    blend_high: float = 1.5  # and widest

    def __post_init__(self) -> None:
        expect_kind("kind", self.kind, KINDS)
        if not 0.4 <= self.blend_low <= self.blend_high <= 2:
            raise ValueError(
                f"blend_low: expected 0.4 <= blend_low <= blend_high <= 2, got {self.blend_low} and {self.blend_high}"
            )

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        blend = self.blend_low + (self.blend_high - self.blend_low) * spread(index)
        surface = ImplicitSurface(lambda: _body(generator("smooth_csg", split, index), kind, blend))
        return Shape(
            f"smooth_csg-{split}-{index:03d}-{kind}",
            lambda: surface.mesh,
            surface=surface,
            tags=(kind,),
            info={"kind": kind, "blend": blend},
            exactness="implicit",
        )


def _body(rng: np.random.Generator, kind: str, blend: float) -> Body:
    node = KINDS[kind](rng, blend)
    return Body(NodeField(node, random_rotation(rng)), *box_of_ball(1.75), 0.021)


def _around(radius: float, number: int, phase: float = 0.0) -> np.ndarray:
    """Points (number, 3) on a circle about the axis z."""
    angle = phase + np.arange(number) * (2 * pi / number)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(number)], axis=1)


def _turn_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def _machine(rng: np.random.Generator, blend: float) -> Node:
    """A flange or a plate with a hub, ribs that stiffen it, bosses with holes, and perhaps a slot."""
    fillet = 0.07 * blend
    thick, rounding = rng.uniform(0.1, 0.14), 0.06
    number = int(rng.integers(3, 7))
    phase = rng.uniform(0, pi)
    if rng.random() < 0.5:
        body: Node = Placed(sdf.cylinder(1.0, thick, rounding), np.zeros(3), UPRIGHT)
        places, reach = _around(0.74, number, phase), 0.95
    else:
        half = np.array([1.05, rng.uniform(0.65, 0.95), thick])
        body = Placed(sdf.box(half, rounding), np.zeros(3), UPRIGHT)
        signs = np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]])
        places, reach = signs * (half - 0.25), half[1]
    hub_radius, hub_height = rng.uniform(0.28, 0.4), rng.uniform(0.4, 0.75)
    hub_place = np.array([0, 0, hub_height - thick])
    body = Union(body, Placed(sdf.cylinder(hub_radius, hub_height, rounding), hub_place, UPRIGHT), fillet)
    ribs, rib_length = int(rng.integers(2, 7)), (reach - 0.12) / 2
    if rng.random() < 0.8:
        rib = sdf.box(np.array([rib_length, 0.075, 0.5 * hub_height]), 0.05)
        for angle in phase + pi / number + np.arange(ribs) * (2 * pi / ribs):
            turn = _turn_z(angle)
            body = Union(body, Placed(rib, turn @ [rib_length, 0, 0.5 * hub_height], turn), 0.7 * fillet)
    boss = sdf.cylinder(0.19, 0.5 * thick + 0.11, 0.05)
    for place in places:
        body = Union(body, Placed(boss, place + [0, 0, 0.5 * thick + 0.05], UPRIGHT), 0.8 * fillet)
    cut = 0.04 * blend
    for place in places:
        body = Difference(body, Placed(sdf.capsule(1.0, 0.095), place, UPRIGHT), cut)
    bore = sdf.capsule(2.0, hub_radius * rng.uniform(0.5, 0.65))
    return Difference(body, Placed(bore, np.zeros(3), UPRIGHT), cut)


def _organic(rng: np.random.Generator, blend: float) -> Node:
    """Limbs that grow on one another: cones, capsules, rings and balls, with dents."""
    width = 0.2 * blend
    body: Node = Placed(sdf.round_cone(rng.uniform(0.5, 0.8), rng.uniform(0.35, 0.5), 0.25), np.zeros(3), UPRIGHT)
    for _ in range(int(rng.integers(5, 9))):
        place, outward = _on_surface(rng, body)
        turn = _towards(rng, outward)
        size = rng.uniform(0.7, 1.15)
        choice = rng.integers(4)
        if choice == 0:
            limb = sdf.round_cone(0.75 * size, 0.2 * size, 0.1 * size)
        elif choice == 1:
            limb = sdf.capsule(0.5 * size, 0.13 * size)
        elif choice == 2:  # the ring stands on the surface
            limb, turn = sdf.torus(0.33 * size, 0.1 * size), turn @ ALONG_X
            place = place + 0.27 * size * outward
        else:
            limb, place = sdf.sphere(0.3 * size), place + 0.15 * size * outward
        body = Union(body, Placed(limb, place, turn), width)
    for _ in range(int(rng.integers(1, 4))):
        place, outward = _on_surface(rng, body)
        body = Difference(body, Placed(sdf.sphere(0.22), place + 0.12 * outward, UPRIGHT), 0.06 * blend)
    return body


def _housing(rng: np.random.Generator, blend: float) -> Node:
    """A hollow box, ball or drum with windows through its walls and a collar."""
    cut = 0.05 * blend
    wall = rng.uniform(0.1, 0.15)
    outer, inner = _hollow(rng, wall)
    body: Node = Difference(Placed(outer, np.zeros(3), UPRIGHT), Placed(inner, np.zeros(3), UPRIGHT), 0.04)
    collar = sdf.torus(rng.uniform(0.45, 0.55), rng.uniform(0.14, 0.2))
    body = Union(body, Placed(collar, np.array([0, 0, 0.82]), UPRIGHT), 0.12 * blend)
    body = Difference(body, Placed(sdf.capsule(1.0, 0.34), np.array([0, 0, 1.4]), UPRIGHT), cut)
    number = int(rng.integers(3, 6))
    height, radius = rng.uniform(0.12, 0.3), rng.uniform(0.16, 0.24)
    phase = rng.uniform(0, pi)
    for angle in phase + np.arange(number) * (2 * pi / number):
        # A window is a slot: a capsule upright, drawn out along the normal of the wall.
        slot = sdf.box(np.array([1.0, radius, radius + height]), 0.95 * radius)
        turn = _turn_z(angle)
        body = Difference(body, Placed(slot, turn @ [1.1, 0, -0.1], turn), cut)
    return body


def _hollow(rng: np.random.Generator, wall: float) -> tuple[sdf.Local, sdf.Local]:
    """The outside and the inside of a hollow body of about radius 0.9."""
    choice = rng.integers(3)
    if choice == 0:
        half = np.array([rng.uniform(0.75, 0.95), rng.uniform(0.75, 0.95), 0.85])
        return sdf.box(half, 0.3), sdf.box(half - wall, 0.3 - 0.8 * wall)
    if choice == 1:
        return sdf.sphere(0.95), sdf.sphere(0.95 - wall)
    radius = rng.uniform(0.75, 0.9)
    return sdf.cylinder(radius, 0.88, 0.25), sdf.cylinder(radius - wall, 0.88 - wall, 0.25 - 0.8 * wall)


def _pipes(rng: np.random.Generator, blend: float) -> Node:
    """Pipes that meet in a ball, with rims at their ends, bored through."""
    number = int(rng.integers(3, 7))
    directions = _spread_directions(rng, number)
    radii = rng.uniform(0.2, 0.3, size=number)
    lengths = rng.uniform(0.85, 1.15, size=number)
    core: Node = Placed(sdf.sphere(rng.uniform(0.42, 0.55)), np.zeros(3), UPRIGHT)
    turns = [_towards(rng, direction) for direction in directions]
    parts = []
    for turn, radius, length in zip(turns, radii, lengths, strict=True):
        pipe = sdf.cylinder(radius, length / 2, 0.05)
        parts.append(Placed(pipe, turn[:, 2] * length / 2, turn))
    body = reduce(lambda one, other: Union(one, other, 0.14 * blend), parts, core)
    for turn, radius, length in zip(turns, radii, lengths, strict=True):
        rim = sdf.cylinder(radius + 0.1, 0.09, 0.05)
        body = Union(body, Placed(rim, turn[:, 2] * (length - 0.1), turn), 0.04 * blend)
    bores: list[Node] = [
        Placed(sdf.capsule(0.75, 0.62 * radius), turn[:, 2] * 0.75, turn)
        for turn, radius in zip(turns, radii, strict=True)
    ]
    bore = reduce(lambda one, other: Union(one, other, 0.05 * blend), bores)
    return Difference(body, bore, 0.03 * blend)


def _spread_directions(rng: np.random.Generator, number: int) -> np.ndarray:
    """Unit vectors (number, 3), each the one of forty that is farthest from the previous ones."""
    chosen = np.empty((0, 3))
    for _ in range(number):
        candidates = rng.normal(size=(40, 3))
        candidates /= np.linalg.norm(candidates, axis=1, keepdims=True)
        nearest = np.einsum("ni,ki->nk", candidates, chosen).max(axis=1, initial=-1)
        chosen = np.vstack([chosen, candidates[nearest.argmin()]])
    return chosen


def _towards(rng: np.random.Generator, direction: np.ndarray) -> np.ndarray:
    """A rotation that takes the axis z to ``direction``, with a random angle about it."""
    side = np.cross(direction, rng.normal(size=3))
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(direction, side), direction], axis=1)


def _on_surface(rng: np.random.Generator, node: Node) -> tuple[np.ndarray, np.ndarray]:
    """A random point of a body's outer surface, and the normal there: two (3,) arrays."""
    point = rng.normal(size=(1, 3))
    point *= 1.5 / np.linalg.norm(point)
    for _ in range(60):  # values are lower bounds of the distance, so the steps do not run through the surface
        value, gradient = node.gradient(point)
        point = point - value[:, None] * gradient
    return point[0], gradient[0] / np.linalg.norm(gradient)


KINDS: dict[str, Callable[[np.random.Generator, float], Node]] = {
    "machine": _machine,
    "organic": _organic,
    "housing": _housing,
    "pipes": _pipes,
}
