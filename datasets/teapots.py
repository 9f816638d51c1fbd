"""Teapots and mugs: bodies with a handle, so that no sphere can be deformed into one without a tear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of, spread
from .common.rotations import random_rotation
from .surfaces import sdf_nodes as sdf
from .surfaces.implicit import Body, ImplicitSurface, box_of_ball
from .surfaces.sdf_nodes import Difference, Intersection, Node, NodeField, Placed, Union

UPRIGHT = np.eye(3)
RING = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).T  # turns the axis of a ring from z to y


@register("dataset", requires=("scipy", "skimage", "trimesh"))
@dataclass(frozen=True)
class Teapots(Family):
    """Teapots (body, lid, spout, handle) and mugs; of genus 1; exact samples, normals and closest points.

    Smooth unions of rounded primitives, as in ``smooth_csg``. A teapot is solid, a mug is hollow with a wall of
    constant thickness. The hole of the handle is at least 0.2 radii wide: visible in images of 128 pixels. Shapes are
    rotated at random.
    """

    kind: Literal["all", "teapot", "mug"] = "all"  # in turn
    upright: bool = False  # the axis is z, and the handle points along -x

    def __post_init__(self) -> None:
        expect_kind("kind", self.kind, KINDS)

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        surface = ImplicitSurface(lambda: self._body(generator("teapots", split, index), kind, spread(index)))
        return Shape(
            f"teapots-{split}-{index:03d}-{kind}",
            lambda: surface.mesh,
            surface=surface,
            tags=(kind,),
            info={"kind": kind, "genus": 1},
            exactness="implicit",
        )

    def _body(self, rng: np.random.Generator, kind: str, size: float) -> Body:
        node = KINDS[kind](rng, size)
        turn = UPRIGHT if self.upright else random_rotation(rng)
        return Body(NodeField(node, turn), *box_of_ball(1.9), 0.026)


def _teapot(rng: np.random.Generator, size: float) -> Node:
    """A belly with a flat foot, a lid with a knob, a bent spout and a ring for a handle."""
    belly, height = rng.uniform(0.68, 0.8), rng.uniform(0.5, 0.62)
    body: Node = Placed(sdf.sphere(belly), np.zeros(3), UPRIGHT)
    body = Intersection(body, Placed(sdf.cylinder(2 * belly, height, 0.05), np.zeros(3), UPRIGHT), 0.12)
    lid = Placed(sdf.cylinder(rng.uniform(0.32, 0.4), 0.07, 0.05), np.array([0, 0, height]), UPRIGHT)
    knob = Placed(sdf.sphere(rng.uniform(0.09, 0.12)), np.array([0, 0, height + 0.16]), UPRIGHT)
    body = Union(Union(body, lid, 0.05), knob, 0.08)
    body = Union(body, _ring(rng, belly, 0.25 + 0.1 * size, 0.05), 0.05)
    lean = rng.uniform(0.5, 0.8)
    along = np.array([np.sin(lean), 0, np.cos(lean)])
    spout = sdf.round_cone(rng.uniform(0.6, 0.75), 0.2, 0.1)
    return Union(body, Placed(spout, np.array([0.75 * belly, 0, -0.2]), _turn_to(along)), 0.12)


def _mug(rng: np.random.Generator, size: float) -> Node:
    """A cup that is open at the top, with a ring for a handle; outside and inside are a wall apart."""
    radius, half, wall = rng.uniform(0.5, 0.62), rng.uniform(0.6, 0.75), rng.uniform(0.1, 0.14)
    body: Node = Placed(sdf.cylinder(radius, half, 0.1), np.zeros(3), UPRIGHT)
    body = Union(body, _ring(rng, radius, 0.3 + 0.12 * size, 0.0), 0.06)
    inside = sdf.cylinder(radius - wall, half, 0.1 * (1 - wall))
    return Difference(body, Placed(inside, np.array([0, 0, 2 * wall]), UPRIGHT), 0.03)


def _ring(rng: np.random.Generator, radius: float, size: float, raised: float) -> Node:
    """An upright ring of radius ``size`` at the side of a body of revolution; about a third of it is inside."""
    thick = rng.uniform(0.08, 0.1)
    return Placed(sdf.torus(size, thick), np.array([-radius - 0.35 * size, 0, raised]), RING)


def _turn_to(axis: np.ndarray) -> np.ndarray:
    """A rotation that takes z to a unit vector of the plane of x and z."""
    x, _, z = axis
    return np.array([[z, 0, x], [0, 1.0, 0], [-x, 0, z]])


KINDS: dict[str, Callable[[np.random.Generator, float], Node]] = {"teapot": _teapot, "mug": _mug}
