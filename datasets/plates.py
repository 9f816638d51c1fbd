"""Thin sheets: flat, corrugated, folded and egg-box plates over three decades of thickness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of, spread
from .common.rotations import random_rotation
from .details.sheets import LENGTH, Sheet, corrugated, egg_box, flat, folded
from .surfaces.parametric import ParametricSurface

KINDS = ("corrugated", "folded", "flat", "egg_box")


@register("dataset", requires=("igl", "scipy", "trimesh"))
@dataclass(frozen=True)
class Plates(Family):
    """Sheets of constant thickness; exact samples, normals and closest points.

    A middle surface (a rectangle, a sine wave, flats with round bends between them, or an egg box) is moved exactly by
    half the thickness to either side. The logarithms of the ratios of thickness to length are spread evenly over the
    range. The ends are straight or, for every other shape except egg boxes, half-round. A hem is folded back onto
    itself. Shapes are rotated at random.
    """

    ratio_low: float = 3e-3  # thinnest sheet: thickness over the length of 2
    ratio_high: float = 1e-1  # thickest sheet
    kind: Literal["all", "flat", "corrugated", "folded", "egg_box"] = "all"  # of plate
    spacing: float = 0.016  # edge length of the tessellation, for a length of 2

    def __post_init__(self) -> None:
        if not 1e-3 <= self.ratio_low <= 0.1:
            raise ValueError(f"ratio_low: expected 0.001 to 0.1, got {self.ratio_low}")
        if not self.ratio_low <= self.ratio_high <= 0.1:
            raise ValueError(f"ratio_high: expected ratio_low={self.ratio_low} to 0.1, got {self.ratio_high}")
        expect_kind("kind", self.kind, KINDS)
        if not 0.004 <= self.spacing <= 0.1:
            raise ValueError(f"spacing: expected 0.004 to 0.1, got {self.spacing}")

    def _shape(self, split: str, index: int) -> Shape:
        rng = generator("plates", split, index)
        ratio = self.ratio_high * (self.ratio_low / self.ratio_high) ** spread(index, 0.85)
        kind = kind_of(self.kind, KINDS, index)
        turn = index // len(KINDS) if self.kind == "all" else index
        thickness = ratio * LENGTH
        make = {"flat": flat, "corrugated": corrugated, "folded": folded, "egg_box": egg_box}[kind]
        middle = make(rng, thickness, turn)
        ends = "round" if kind != "egg_box" and (turn + KINDS.index(kind)) % 2 else "flat"
        sheet = Sheet(middle, thickness, ends, self.spacing)
        surface = ParametricSurface(sheet.parts, random_rotation(rng))
        diagonal = sheet.diagonal
        info = {
            "kind": middle.name,
            "ends": ends,
            "genus": 0,
            "ratio": ratio,
            "thickness": thickness / diagonal,
            "wall": thickness,
            "symmetry": middle.symmetry,
        }
        name = f"plates-{split}-{index:03d}-{kind}"
        return Shape(name, surface.mesh, surface=surface, tags=(kind,), info=info, exactness="parametric")
