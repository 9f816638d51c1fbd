"""Assemblies of machine parts, with narrow clearances and screw threads; the mesh is the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of, spread
from .common.rotations import random_rotation
from .solids.assembled import KINDS, Assembly
from .solids.booleans import arrays, turned

if TYPE_CHECKING:
    from manifold3d import Manifold

SIZE = 2.4  # approximate size of an assembly


@register("dataset", requires=("manifold3d", "trimesh"))
@dataclass(frozen=True)
class Assemblies(Family):
    """Bolted plates, ball bearings, hinges and jars with lids: bodies with one clearance, and metric threads.

    Every body is a closed manifold and a separate component; none touches another, and where two face each other,
    also along the flanks of a thread, they are ``gap`` apart. The logarithms of the gaps are spread evenly between the
    two limits. The assembly is rotated at random. Info: ``gap``, relative to the diagonal of the box before the
    rotation, to 10 % (round bodies have facets), ``size``, about that diagonal, and the number of ``threads``.
    """

    gap_low: float = 1e-3  # narrowest clearance, relative to the size of an assembly
    gap_high: float = 8e-3  # widest: threads still hold
    kind: Literal["all", "bolted", "bearing", "hinge", "jar"] = "all"  # of assembly

    def __post_init__(self) -> None:
        if not 2e-4 <= self.gap_low <= self.gap_high:
            raise ValueError(f"gap_low: expected 0.0002 to gap_high={self.gap_high}, got {self.gap_low}")
        if not self.gap_high <= 0.01:
            raise ValueError(f"gap_high: expected at most 0.01, got {self.gap_high}")
        expect_kind("kind", self.kind, KINDS)

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        rng = generator("assemblies", split, index)
        gap = SIZE * self.gap_low * (self.gap_high / self.gap_low) ** spread(index)
        assembly, rotation = KINDS[kind](rng, gap), random_rotation(rng)
        info = {
            "kind": kind,
            "genus": assembly.genus,
            "components": assembly.components,
            "gap": float(gap / assembly.size),
            "size": float(assembly.size),
            "threads": assembly.threads,
        }
        return Shape(
            f"assemblies-{split}-{index:03d}-{kind}",
            lambda: turned(*arrays(_gathered(assembly)), rotation),
            tags=(kind,),
            info=info,
            exactness="polyhedron",
        )


def _gathered(assembly: Assembly) -> Manifold:
    from manifold3d import Manifold

    return Manifold.compose(assembly.build()).simplify(1e-5)  # removes the slivers that remain where two cuts meet
