"""Scenes of several solids with narrow gaps between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi, radians, sin
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of, spread
from .common.rotations import random_rotation
from .solids.booleans import arrays, turned

if TYPE_CHECKING:
    from manifold3d import Manifold

SEGMENTS = 64


class Item(NamedTuple):
    """A solid on the plane z = 0, centred in x and y."""

    size: np.ndarray  # of its bounding box
    build: Callable[[], Manifold]
    genus: int = 0

    def at(self, x: float, y: float, z: float) -> Placed:
        """The item, moved."""
        return Placed(self, np.array([x, y, z]))


class Placed(NamedTuple):
    """An item of a scene and the position of its foot."""

    item: Item
    place: np.ndarray

    @property
    def box(self) -> np.ndarray:
        """The lowest and highest corner, (2, 3)."""
        half = self.item.size * (0.5, 0.5, 0)
        return self.place + np.array([-half, self.item.size - half])


def row(rng: np.random.Generator, gap: float) -> list[Placed]:
    """Solids side by side, over a board."""
    items = [_thing(rng) for _ in range(int(rng.integers(4, 7)))]
    placed, x = [], 0.0
    for item in items:
        placed.append(item.at(x + item.size[0] / 2, 0, 0))
        x += item.size[0] + gap
    return [*placed, _board(placed, gap)]


def stack(rng: np.random.Generator, gap: float) -> list[Placed]:
    """Books and boards on one another, with a cup or a block on top."""
    placed, z = [], 0.0
    for _ in range(int(rng.integers(4, 8))):
        book = _box(rng.uniform(0.6, 1.0), rng.uniform(0.5, 0.75), rng.uniform(0.06, 0.2))
        placed.append(book.at(rng.uniform(-0.08, 0.08), rng.uniform(-0.06, 0.06), z))
        z += book.size[2] + gap
    return [*placed, (_cup if rng.random() < 0.5 else _cylinder)(rng).at(0.05, 0.0, z)]


def links(rng: np.random.Generator, gap: float) -> list[Placed]:
    """A chain: each ring goes through the next."""
    tube = rng.uniform(0.07, 0.11)
    radius = rng.uniform(3.2, 4.5) * tube + gap
    step = 2 * radius - 2 * tube - gap
    size = 2 * (radius + tube)
    flat = Item(np.array([size, size, 2 * tube]), lambda: _ring(radius, tube).translate((0, 0, tube)), 1)
    upright = Item(
        np.array([size, 2 * tube, size]),
        lambda: _ring(radius, tube).rotate((90, 0, 0)).translate((0, 0, radius + tube)), 1,
    )  # fmt: skip
    chain = []
    for i in range(int(rng.integers(3, 6))):
        item = upright if i % 2 else flat
        chain.append(item.at(i * step, 0, -item.size[2] / 2))
    return chain


def nested(rng: np.random.Generator, gap: float) -> list[Placed]:
    """Pipes within pipes, and a peg in the middle, over a board."""
    placed, radius = [], rng.uniform(0.12, 0.2)
    height = rng.uniform(0.8, 1.2)
    inner, clear = 0.0, gap / cos(pi / SEGMENTS)  # the flat walls of two polygons are nearer than their corners
    for i in range(int(rng.integers(3, 5))):
        tall = height * (1 - 0.17 * i)
        placed.append(_pipe(inner, inner + radius, tall).at(0, 0, 0))
        inner += radius + clear
        radius = rng.uniform(0.05, 0.1)
    return [*placed, _board(placed, gap)]


def leaning(rng: np.random.Generator, gap: float) -> list[Placed]:
    """Boards that lean against a block, over a board."""
    block = _box(rng.uniform(0.3, 0.5), rng.uniform(0.5, 0.8), rng.uniform(0.9, 1.2))
    placed = [block.at(0, 0, 0)]
    for side in (-1, 1):
        angle = side * rng.uniform(14, 24)
        board = _tilted(rng.uniform(0.05, 0.12), rng.uniform(0.4, 0.7), rng.uniform(0.6, 0.85), angle)
        placed.append(board.at(-side * (block.size[0] / 2 + gap + board.size[0] / 2), 0, 0))
    ball = _ball(rng.uniform(0.12, 0.2))
    placed.append(ball.at(0, 0, block.size[2] + gap))
    return [*placed, _board(placed, gap)]


KINDS = {kind.__name__: kind for kind in (row, links, stack, nested, leaning)}


@register("dataset", requires=("manifold3d", "trimesh"))
@dataclass(frozen=True)
class Scenes(Family):
    """Several solids with one gap between neighbours: rows, chains, stacks, nested pipes and leaning boards.

    The logarithms of the gaps are spread evenly between the two limits. Every solid is a separate component; the scene
    is rotated at random. Info: ``gap``, relative to the diagonal of the scene's box before the rotation, and ``size``,
    that diagonal.
    """

    gap_low: float = 1e-3  # narrowest gap, relative to the approximate size of the scene
    gap_high: float = 1e-1  # widest
    kind: Literal["all", "row", "links", "stack", "nested", "leaning"] = "all"  # of scene

    def __post_init__(self) -> None:
        if not 1e-4 <= self.gap_low <= self.gap_high:
            raise ValueError(f"gap_low: expected 0.0001 to gap_high={self.gap_high}, got {self.gap_low}")
        if not self.gap_high <= 0.2:
            raise ValueError(f"gap_high: expected at most 0.2, got {self.gap_high}")
        expect_kind("kind", self.kind, KINDS)

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        rng = generator("scenes", split, index)
        gap = 1.5 * self.gap_low * (self.gap_high / self.gap_low) ** spread(index)
        placed, rotation = KINDS[kind](rng, gap), random_rotation(rng)
        boxes = np.array([one.box for one in placed])
        size = float(np.linalg.norm(boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)))
        info = {
            "kind": kind,
            "genus": sum(one.item.genus for one in placed),
            "components": len(placed),
            "gap": float(gap / size),
            "size": size,
        }
        return Shape(
            f"scenes-{split}-{index:03d}-{kind}",
            lambda: turned(*arrays(_gathered(placed)), rotation),
            tags=(kind,),
            info=info,
            exactness="polyhedron",
        )


def _gathered(placed: list[Placed]) -> Manifold:
    from manifold3d import Manifold

    return Manifold.compose([one.item.build().translate(one.place) for one in placed])


def _thing(rng: np.random.Generator) -> Item:
    kinds = (_cup, _cylinder, _arch, lambda r: _ball(r.uniform(0.12, 0.22)),
             lambda r: _box(r.uniform(0.15, 0.4), r.uniform(0.3, 0.6), r.uniform(0.4, 1.0)))  # fmt: skip
    return kinds[int(rng.integers(len(kinds)))](rng)


def _board(placed: list[Placed], gap: float) -> Placed:
    """A board below all."""
    boxes = np.array([one.box for one in placed])
    low, high = boxes[:, 0].min(axis=0) - 0.1, boxes[:, 1].max(axis=0) + 0.1
    board = _box(high[0] - low[0], high[1] - low[1], 0.08)
    return board.at((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, -gap - 0.08)


def _box(x: float, y: float, z: float) -> Item:
    def build() -> Manifold:
        from manifold3d import Manifold

        return Manifold.cube((x, y, z), True).translate((0, 0, z / 2))

    return Item(np.array([x, y, z]), build)


def _tilted(x: float, y: float, z: float, angle: float) -> Item:
    """A box, turned about y by ``angle`` degrees, on its lowest edge."""
    c, s = abs(cos(radians(angle))), abs(sin(radians(angle)))
    size = np.array([x * c + z * s, y, x * s + z * c])

    def build() -> Manifold:
        from manifold3d import Manifold

        return Manifold.cube((x, y, z), True).rotate((0, angle, 0)).translate((0, 0, size[2] / 2))

    return Item(size, build)


def _pipe(inner: float, outer: float, height: float) -> Item:
    def build() -> Manifold:
        from manifold3d import Manifold

        solid = Manifold.cylinder(height, outer, outer, SEGMENTS)
        if inner:
            solid -= Manifold.cylinder(height + 0.2, inner, inner, SEGMENTS).translate((0, 0, -0.1))
        return solid

    return Item(np.array([2 * outer, 2 * outer, height]), build, int(inner > 0))


def _cylinder(rng: np.random.Generator) -> Item:
    return _pipe(0.0, rng.uniform(0.1, 0.22), rng.uniform(0.4, 1.0))


def _ball(radius: float) -> Item:
    def build() -> Manifold:
        from manifold3d import Manifold

        return Manifold.sphere(radius, 2 * SEGMENTS).translate((0, 0, radius))

    return Item(np.full(3, 2 * radius), build)


def _cup(rng: np.random.Generator) -> Item:
    """A cup, its wall widening upwards."""
    radius, height, wall = rng.uniform(0.16, 0.24), rng.uniform(0.35, 0.6), rng.uniform(0.02, 0.04)
    foot = radius * rng.uniform(0.65, 0.9)

    def build() -> Manifold:
        from manifold3d import Manifold

        inside = Manifold.cylinder(height, foot - wall, radius - wall, SEGMENTS).translate((0, 0, wall))
        return Manifold.cylinder(height, foot, radius, SEGMENTS) - inside

    return Item(np.array([2 * radius, 2 * radius, height]), build)


def _arch(rng: np.random.Generator) -> Item:
    width, depth, height = rng.uniform(0.5, 0.7), rng.uniform(0.25, 0.4), rng.uniform(0.45, 0.7)
    radius = rng.uniform(0.28, 0.36) * width

    def build() -> Manifold:
        from manifold3d import Manifold

        opening = Manifold.cylinder(depth + 0.2, radius, radius, SEGMENTS, True).rotate((90, 0, 0))
        opening = opening.translate((0, 0, height - radius - 0.1))
        door = Manifold.cube((2 * radius, depth + 0.2, height - radius), True).translate(
            (0, 0, (height - radius) / 2 - 0.1)
        )
        return Manifold.cube((width, depth, height), True).translate((0, 0, height / 2)) - (opening + door)

    return Item(np.array([width, depth, height]), build)


def _ring(radius: float, tube: float) -> Manifold:
    from manifold3d import CrossSection

    return CrossSection.circle(tube, 32).translate((radius, 0)).revolve(2 * SEGMENTS)
