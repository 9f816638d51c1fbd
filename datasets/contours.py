"""Closed curves in a plane: outlines of digits and letters, blobs, polygons and stars."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of
from .outlines.figures import blob, rounded, star
from .outlines.glyphs import GLYPHS, glyph
from .outlines.pieces import normalised
from .surfaces.plane_curves import PlaneCurves

KINDS = ("digit", "letter", "blob", "polygon", "star")
LONGEST = 0.02  # edge of the ribbon along the curve, radius 1


@register("dataset", requires=("scipy", "skimage", "trimesh"))
@dataclass(frozen=True)
class Contours(Family):
    """Closed plane curves on thin ribbons: glyphs, blobs, polygons, stars; exact samples, normals and closest points.

    The two-dimensional test bed of upsampling papers. The surface is the curve, in the plane z = 0: samples are uniform
    by its length, evenly spread points are even along it, normals lie in the plane. The mesh is a thin ribbon that
    stands on it: distances to the ribbon and to the curve differ by less than half its height and the tolerance.
    Digits and letters are the outlines of pen strokes, with their holes; the points of the strokes, slant, width and
    proportions vary. Polygons have round corners, every other star has sharp ones.

    Measures that use an area have no meaning for a curve: the metrics ``coverage``, ``uniformity`` and
    ``projected_uniformity``, and an input's ``coverage`` and ``density_variation``.
    """

    kind: Literal["all", "digit", "letter", "blob", "polygon", "star"] = "all"  # of curve
    height: float = 2e-4  # of the ribbon, relative to the radius of the curve
    tolerance: float = 1e-5  # how far the ribbon may be from the curve, in the same unit

    def __post_init__(self) -> None:
        expect_kind("kind", self.kind, KINDS)
        if not 0 < self.height <= 0.1:
            raise ValueError(f"height: expected above 0 and up to 0.1, got {self.height}")
        if not 1e-8 <= self.tolerance <= 0.01:
            raise ValueError(f"tolerance: expected 1e-8 to 0.01, got {self.tolerance}")

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        turn = index // len(KINDS) if self.kind == "all" else index
        names = list(GLYPHS.get(kind, ()))
        name = names[turn % len(names)] if names else kind
        count = GLYPHS[kind][name][0] if names else 1

        def curves() -> list[np.ndarray]:
            return normalised(_drawn(kind, name, turn, generator("contours", split, index)))

        surface = PlaneCurves(curves)
        info = {"kind": kind, "name": name, "curves": count, "genus": 0}
        return Shape(
            f"contours-{split}-{index:03d}-{name}",
            lambda: surface.ribbon(self.height, self.tolerance, LONGEST),
            surface=surface,
            tags=(kind,),
            info=info,
            exactness="parametric",
        )


def _drawn(kind: str, name: str, turn: int, rng: np.random.Generator) -> list[np.ndarray]:
    """The closed curves of one shape."""
    if kind in GLYPHS:
        return glyph(kind, name, rng)
    if kind == "star":
        return [star(rng, sharp=turn % 2 == 1)]
    return [{"blob": blob, "polygon": rounded}[kind](rng)]
