"""Chairs, tables and shelves, with labelled parts and, in pairs, the same faces within a category."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING, Literal

import numpy as np

from bench import Shape, ShapePair, generator, register

from .common.family import expect_kind, kind_of
from .common.rotations import random_rotation
from .solids.booleans import arrays, origins, turned
from .solids.furniture_parts import CATEGORIES, Piece, bar_grid

if TYPE_CHECKING:
    from manifold3d import Manifold
    from trimesh import Trimesh


@register("dataset", requires=("manifold3d", "trimesh"))
@dataclass(frozen=True)
class Furniture:
    """Chairs, tables and shelves of 13 to 15 measures each, in turn; parts are labelled.

    ``shapes`` are unions: one closed manifold each, rotated at random. ``pairs`` are upright, not rotated, with every
    optional part, and their parts are closed meshes that overlap at the joints: this gives all pieces of a category
    the same faces, so that vertex i of one corresponds to vertex i of another. With ``same_parts=false`` a pair's two
    pieces differ in their optional parts (slats, armrests, stretchers, boards): the source still consists of closed
    parts, the target is a union, and there is no correspondence. Metres; z is up, the front is -y.
    """

    category: Literal["all", "chair", "table", "shelf"] = "all"  # of furniture
    same_parts: bool = True  # whether the two pieces of a pair have the same parts, and correspond

    def __post_init__(self) -> None:
        expect_kind("category", self.category, CATEGORIES)

    def shapes(self, split: str) -> Iterator[Shape]:
        """The endless shapes of a split; ``train`` and ``test`` come from different seeds."""
        for index in count():
            category = self._category(index)
            rng = generator("furniture", split, index)
            piece, rotation = CATEGORIES[category](rng, full=False), random_rotation(rng)
            yield _union(f"furniture-{split}-{index:03d}-{category}", category, piece, rotation)

    def pairs(self, split: str) -> Iterator[ShapePair]:
        """Two pieces of one category; with ``same_parts`` they have the same faces."""
        for index in count():
            if not self.same_parts:
                yield self._unlike(split, index)
                continue
            category, rng = self._category(index), generator("furniture pairs", split, index)
            id = f"furniture-{split}-{index:03d}-{category}"
            source, target = CATEGORIES[category](rng, full=True), CATEGORIES[category](rng, full=True)
            marks = {name: _vertex(*at) for name, at in source.landmarks.items()}
            shapes = _parts(f"{id}-source", category, source), _parts(f"{id}-target", category, target)
            yield ShapePair(id, shapes[0], shapes[1], marks)

    def _unlike(self, split: str, index: int) -> ShapePair:
        """Two pieces of one category that differ in their optional parts."""
        category, rng = self._category(index), generator("furniture unlike pairs", split, index)
        source = target = CATEGORIES[category](rng, full=False)
        while _names(target) == _names(source):
            target = CATEGORIES[category](rng, full=False)
        id = f"furniture-{split}-{index:03d}-{category}"
        whole = _union(f"{id}-target", category, target, np.eye(3))
        return ShapePair(id, _parts(f"{id}-source", category, source), whole, corresponding=False)

    def _category(self, index: int) -> str:
        return kind_of(self.category, CATEGORIES, index)


def _info(category: str, piece: Piece) -> dict:
    return {
        "category": category,
        "parts": _names(piece),
        "symmetry": _symmetry(category),
        **piece.measures,
    }


def _symmetry(category: str) -> str:
    return {"chair": "mirror x", "table": "mirror x y", "shelf": "none"}[category]


def _thickness(piece: Piece) -> float:
    """The thinnest bar or board, relative to the diagonal of the box."""
    points = np.concatenate([bar.vertices() for bar in piece.bars])
    thinnest = min(min(*bar.start, *bar.end, float(np.linalg.norm(bar.b - bar.a)) / 2) for bar in piece.bars)
    return float(2 * thinnest / np.linalg.norm(np.ptp(points, axis=0)))


def _names(piece: Piece) -> list[str]:
    return [bar.name for bar in piece.bars]


def _union(id: str, category: str, piece: Piece, rotation: np.ndarray) -> Shape:
    thickness = _thickness(piece)
    made: list = []

    def make() -> tuple[Trimesh, np.ndarray]:
        if not made:
            solids = [_solid(bar.vertices()) for bar in piece.bars]
            union = _joined(solids)
            mesh = turned(*arrays(union), rotation)
            made.append((mesh, origins(union, [solid.original_id() for solid in solids])))
        return made[0]

    info = {"genus": piece.genus, "thickness": thickness, **_info(category, piece)}
    return Shape(
        id,
        lambda: make()[0],
        tags=(category,),
        info=info,
        exactness="polyhedron",
        attributes=lambda: {"part": make()[1]},
    )


def _solid(vertices: np.ndarray) -> Manifold:
    from manifold3d import Manifold, Mesh64

    mesh = Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(bar_grid()[1].astype(np.uint64)))
    return Manifold(mesh).as_original()


def _joined(solids: list[Manifold]) -> Manifold:
    from manifold3d import Manifold, OpType

    return Manifold.batch_boolean(solids, OpType.Add)


def _parts(id: str, category: str, piece: Piece) -> Shape:
    """All parts of a piece as one mesh, each part a component."""
    faces = bar_grid()[1]
    size, n = len(bar_grid()[0]), len(piece.bars)

    def make() -> Trimesh:
        from trimesh import Trimesh

        vertices = np.concatenate([bar.vertices() for bar in piece.bars])
        return Trimesh(vertices, np.concatenate([faces + k * size for k in range(n)]), process=False)

    info = {"genus": 0, "components": n, "thickness": _thickness(piece), **_info(category, piece)}
    labels = np.repeat(np.arange(n), len(faces))
    return Shape(id, make, tags=(category,), info=info, exactness="polyhedron", attributes={"part": labels})


def _vertex(bar: int, corner: tuple[int, int, int]) -> int:
    grid, _ = bar_grid()
    return bar * len(grid) + int(np.abs(grid - corner).sum(axis=1).argmin())
