"""Cloth: open sheets with deep folds whose sides nearly touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of, spread
from .common.rotations import random_rotation
from .details.drapery import KINDS
from .surfaces.parametric import Chart, ParametricSurface, Patch


@register("dataset", requires=("igl", "scipy", "trimesh"))
@dataclass(frozen=True)
class Cloth(Family):
    """Curtains, skirts, napkins, scrolls and draped cloth: open sheets; exact samples, normals and closest points.

    A sheet without thickness, in closed form. The folds of curtains, skirts and napkins lean over, the turns of a
    scroll lie on each other: the gap between facing parts has a logarithm that is spread evenly between the two limits
    (a gap wider than the folds allow becomes the widest possible). Draped cloth has no such gap. Info: the approximate
    ``gap``, relative to the diagonal of the box before the sheet is rotated.
    """

    gap_low: float = 0.006  # narrowest gap between folds; a sheet is about 2 across
    gap_high: float = 0.06  # widest
    kind: Literal["all", "curtain", "skirt", "napkin", "scroll", "drape"] = "all"  # of cloth

    def __post_init__(self) -> None:
        if not 0.001 <= self.gap_low <= self.gap_high:
            raise ValueError(f"gap_low: expected 0.001 to gap_high={self.gap_high}, got {self.gap_low}")
        if not self.gap_high <= 0.1:
            raise ValueError(f"gap_high: expected at most 0.1, got {self.gap_high}")
        expect_kind("kind", self.kind, KINDS)

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        rng = generator("cloth", split, index)
        sheet = KINDS[kind](rng, self.gap_low * (self.gap_high / self.gap_low) ** spread(index, 0.2))
        surface = ParametricSurface(
            lambda: ([Chart(sheet.position)], [Patch(0, sheet.u, sheet.v)]), random_rotation(rng)
        )
        info = {"kind": kind, "components": 1}
        if sheet.gap is not None:
            info["gap"] = sheet.gap / sheet.diagonal
        return Shape(
            f"cloth-{split}-{index:03d}-{kind}",
            surface.mesh,
            surface=surface,
            tags=(kind,),
            info=info,
            exactness="parametric",
        )
