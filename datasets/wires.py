"""Wires and lattices that are thinner than half a per cent of the radius; the mesh is the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of, spread
from .common.rotations import random_rotation
from .solids.booleans import arrays, turned
from .solids.wirework import KINDS, solid


@register("dataset", requires=("manifold3d", "trimesh"))
@dataclass(frozen=True)
class Wires(Family):
    """Strut lattices, wire cloth, springs, cages and masts of wire that is 0.15 to 0.45 % of the radius thick.

    Round wires of eight sides along centre lines, closed manifolds, rotated at random. The struts of lattices, cages
    and masts are one body of high genus; the wires of a cloth, and a spring within another, are separate bodies that
    do not touch. The logarithms of the diameters, relative to the distance of the farthest wire from the middle, are
    spread evenly between the two limits. Info: ``thickness``, that diameter.
    """

    thickness_low: float = 0.0015  # diameter of the thinnest wire, relative to the radius of the shape
    thickness_high: float = 0.0045  # of the thickest
    kind: Literal["all", "lattice", "woven", "spring", "cage", "pylon"] = "all"  # of wirework

    def __post_init__(self) -> None:
        if not 2e-4 <= self.thickness_low <= self.thickness_high:
            raise ValueError(
                f"thickness_low: expected 0.0002 to thickness_high={self.thickness_high}, got {self.thickness_low}"
            )
        if not self.thickness_high <= 0.02:
            raise ValueError(f"thickness_high: expected at most 0.02, got {self.thickness_high}")
        expect_kind("kind", self.kind, KINDS)

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        rng = generator("wires", split, index)
        thickness = self.thickness_low * (self.thickness_high / self.thickness_low) ** spread(index)
        work, rotation = KINDS[kind](rng, thickness), random_rotation(rng)
        info = {"kind": kind, "genus": work.genus, "components": work.components, "thickness": thickness}
        return Shape(
            f"wires-{split}-{index:03d}-{kind}",
            lambda: turned(*arrays(solid(work, thickness)), rotation),
            tags=(kind,),
            info=info,
            exactness="polyhedron",
        )
