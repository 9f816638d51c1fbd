"""Buildings: towers, houses, temples, churches and viaducts; the mesh is the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of
from .common.rotations import random_rotation
from .solids.architecture import KINDS
from .solids.booleans import arrays, turned


@register("dataset", requires=("manifold3d", "trimesh"))
@dataclass(frozen=True)
class Buildings(Family):
    """Towers, houses, temples, churches, viaducts: rows of equal openings, long thin elements, ornament on flat walls.

    Closed manifold meshes of one component, each kind in turn, rotated at random. Glazing bars, railings, columns and
    balusters stand free, so most have a high genus. Info: ``openings``, the number of equal windows, arches or spaces
    between columns, and ``thinnest``, the width of the thinnest bar of a building about 2 in size.
    """

    kind: Literal["all", "tower", "house", "temple", "church", "arcade"] = "all"  # of building

    def __post_init__(self) -> None:
        expect_kind("kind", self.kind, KINDS)

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        rng = generator("buildings", split, index)
        building, rotation = KINDS[kind](rng), random_rotation(rng)
        info = {
            "kind": kind,
            "genus": building.genus,
            "openings": building.openings,
            "thinnest": float(building.thinnest),
        }
        return Shape(
            f"buildings-{split}-{index:03d}-{kind}",
            lambda: turned(*arrays(building.build().simplify(1e-5)), rotation),
            tags=(kind,),
            info=info,
            exactness="polyhedron",
        )
