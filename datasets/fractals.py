"""Fractals of finite depth: detail at every scale, and a genus in the thousands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, hypot, pi, sin, sqrt
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of, spread
from .common.rotations import random_rotation
from .solids.booleans import arrays, turned

if TYPE_CHECKING:
    from manifold3d import Manifold


Arrays = tuple[np.ndarray, np.ndarray]
"""Vertices (v, 3) and faces (f, 3)."""


class Fractal(NamedTuple):
    """A fractal that is not built yet."""

    build: Callable[[], Arrays]
    genus: int
    thinnest: float | None
    size: float
    symmetry: str
    info: dict[str, float]


def menger(rng: np.random.Generator, spread: float) -> Fractal:
    """A Menger sponge: the intersection of three Sierpinski carpets extruded along the axes."""
    level, ratio = 1 + int(3 * ((spread + 0.4) % 1)), 0.24 + 0.2 * spread
    sides = np.array([1.0, rng.uniform(0.8, 1.0), rng.uniform(0.65, 1.0)])

    def build() -> Arrays:
        cuts, holed = _cells(level, ratio)
        kept = ~(holed[:, :, None] | holed[:, None, :] | holed[None, :, :])
        return _from_blocks(kept, [cuts * side for side in sides])

    wall = (1 - ratio) / 2
    thinnest = min(sides) * min(wall, ratio if level > 1 else wall) * wall ** (level - 1)
    details = {"level": level, "ratio": ratio}
    return Fractal(build, menger_genus(level), thinnest, float(np.linalg.norm(sides)), "mirror x y z", details)


def menger_genus(level: int) -> int:
    """The genus of the Menger sponge: 0, 5, 81, 1409, ..."""
    return (21 * 20**level + 38 * 8**level - 59) // 133


def carpet(rng: np.random.Generator, spread: float) -> Fractal:
    """A Sierpinski carpet, cut through a plate."""
    level, ratio = 2 + int(2 * ((spread + 0.5) % 1)), 0.25 + 0.2 * rng.random()
    depth, thick = rng.uniform(0.7, 1.0), 0.02 + 0.2 * spread**2
    wall = (1 - ratio) / 2
    thinnest = min(thick, depth * min(wall, ratio) * wall ** (level - 1))
    details = {"level": level, "ratio": ratio, "height": thick}
    size = hypot(1, depth, thick)

    def build() -> Arrays:
        cuts, holed = _cells(level, ratio)
        return _from_blocks(~holed[:, :, None], [cuts, cuts * depth, np.array([0, thick])])

    return Fractal(build, (8**level - 1) // 7, thinnest, size, "mirror x y z", details)


def koch(rng: np.random.Generator, spread: float) -> Fractal:
    """A prism over a Koch snowflake, twisted and tapered."""
    level, corners = 2 + int(2 * spread), int(rng.integers(3, 6))
    bump = rng.uniform(0.55, 0.95) * (1 if corners == 3 else 0.7)  # height of a spike: 1 is the equilateral one
    height, twist, taper = rng.uniform(0.4, 1.4), rng.uniform(0, 80), rng.uniform(0.45, 1.0)
    points = _snowflake(corners, level, bump)

    def build() -> Arrays:
        from manifold3d import CrossSection

        return arrays(CrossSection([points]).extrude(height, 24, twist, (taper, taper)))

    details = {"level": level, "corners": corners, "twist": twist, "taper": taper}
    return Fractal(build, 0, None, 0.0, f"rotation {corners} about z", details)


def cubes(rng: np.random.Generator, spread: float) -> Fractal:
    """A cube with a smaller cube on every face, each of which has smaller cubes on its faces, and so on."""
    level, ratio, twist = 2 + int(2 * ((spread + 0.5) % 1)), 0.3 + 0.1 * spread, rng.uniform(0, 45)

    def build() -> Arrays:
        from manifold3d import Manifold, OpType

        return arrays(Manifold.batch_boolean(_grown(Manifold.cube((1, 1, 1), True), level, ratio, twist), OpType.Add))

    details = {"level": level, "ratio": ratio, "twist": twist}
    return Fractal(build, 0, None, 0.0, "none", details)


KINDS = {kind.__name__: kind for kind in (menger, koch, carpet, cubes)}


@register("dataset", requires=("manifold3d", "trimesh"))
@dataclass(frozen=True)
class Fractals(Family):
    """Menger sponges (genus 5, 81, 1409), Koch prisms, Sierpinski carpets and cubes on cubes; exact polyhedra.

    Ratios, proportions, twist and depth differ from shape to shape, and each is turned at random.
    """

    kind: Literal["all", "menger", "koch", "carpet", "cubes"] = "all"  # of fractal

    def __post_init__(self) -> None:
        expect_kind("kind", self.kind, KINDS)

    def _shape(self, split: str, index: int) -> Shape:
        turn = index if self.kind != "all" else index // len(KINDS)
        kind = kind_of(self.kind, KINDS, index)
        rng = generator("fractals", split, index)
        fractal = KINDS[kind](rng, spread(turn, 0.37))
        rotation = random_rotation(rng)
        info = {"kind": kind, "genus": fractal.genus, "symmetry": fractal.symmetry, **fractal.info}
        if fractal.thinnest is not None:
            info["thickness"] = float(fractal.thinnest / fractal.size)
        return Shape(
            f"fractals-{split}-{index:03d}-{kind}",
            lambda: turned(*fractal.build(), rotation),
            tags=(kind,),
            info=info,
            exactness="polyhedron",
        )


def _cells(level: int, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """The cuts along a side of a Sierpinski carpet (n + 1,), and which of its cells are holes (n, n)."""
    thirds = np.array([0.0, (1 - ratio) / 2, (1 + ratio) / 2])
    cuts, holed = np.array([0.0, 1.0]), np.zeros((1, 1), dtype=bool)
    for _ in range(level):
        cuts = np.append((cuts[:-1, None] + np.diff(cuts)[:, None] * thirds).ravel(), 1.0)
        middle = np.pad([[True]], 1)
        holed = np.kron(holed, np.ones((3, 3), dtype=bool)) | np.tile(middle, (len(holed), len(holed)))
    return cuts, holed


def _from_blocks(kept: np.ndarray, cuts: list[np.ndarray]) -> Arrays:
    """The surface of the union of the blocks ``kept`` (a, b, c) of a grid with these planes: two triangles a side."""
    padded = np.pad(kept, 1)
    numbers = np.arange(np.prod([len(c) for c in cuts])).reshape([len(c) for c in cuts])
    quads = []
    for axis in range(3):
        step = np.diff(padded.astype(np.int8), axis=axis)
        inner = tuple(slice(None) if k == axis else slice(1, -1) for k in range(3))
        u, v = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
        for sign in (1, -1):  # entering: the outside is below
            corner = np.argwhere(step[inner] == sign)
            ring = [corner, corner + u, corner + u + v, corner + v][::-sign]
            quads.append(np.column_stack([numbers[tuple(at.T)] for at in ring]))
    quads = np.concatenate(quads)
    used, quads = np.unique(quads, return_inverse=True)
    quads = quads.reshape(-1, 4)
    grid = np.stack(np.meshgrid(*cuts, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[used], np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def _snowflake(corners: int, level: int, bump: float) -> np.ndarray:
    """A closed Koch curve over a regular polygon, counter-clockwise: (4^level corners, 2) array."""
    points = np.exp(2j * pi * np.arange(corners) / corners)
    for _ in range(level):
        step = np.roll(points, -1) - points
        peak = points + step / 2 - 1j * step * bump * sqrt(3) / 6
        points = np.column_stack([points, points + step / 3, peak, points + 2 * step / 3]).ravel()
    return np.column_stack([points.real, points.imag])


def _grown(cube: Manifold, level: int, ratio: float, twist: float) -> list[Manifold]:
    """The centred cube, and all cubes on its sides and top; below the first level its root is at -z."""
    from manifold3d import Manifold

    def branch(depth: int) -> list[Manifold]:
        """The unit cube on z = 0, its root sunk a little, and the cubes on its five other faces."""
        parts = [Manifold.cube((1, 1, 1.05), True).translate((0, 0, 0.475))]
        if depth:
            child = [part.rotate((0, 0, twist)).scale((ratio,) * 3) for part in branch(depth - 1)]
            parts += [part.translate((0, 0, 1)) for part in child]
            for angle in (0, 90, 180, 270):
                at = (0.5 * cos(pi * angle / 180), 0.5 * sin(pi * angle / 180), 0.5)
                parts += [part.rotate((0, 90, 0)).rotate((0, 0, angle)).translate(at) for part in child]
        return parts

    child = [part.rotate((0, 0, twist)).scale((ratio,) * 3).translate((0, 0, 0.5)) for part in branch(level - 1)]
    ways = [(0, 0, 0), (90, 0, 0), (180, 0, 0), (270, 0, 0), (0, 90, 0), (0, -90, 0)]
    return [cube, *(part.rotate(way) for way in ways for part in child)]
