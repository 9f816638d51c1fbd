"""Machine parts with true fillets and with engraved or embossed numbers; the mesh is the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of
from .common.rotations import random_rotation
from .solids.booleans import arrays, turned
from .solids.filleted import KINDS


@register("dataset", requires=("manifold3d", "scipy", "trimesh"))
@dataclass(frozen=True)
class Parts(Family):
    """Milled and cast parts: plates, brackets, flanges, housings and dials with true fillets and legible numbers.

    Closed manifold meshes of one component, each kind in turn, rotated at random. Edges are rounded by arcs, some
    inner corners too; holes are drilled and countersunk. Numbers are engraved or embossed. Info: the ``text``;
    ``height``, ``depth`` and ``stroke`` of the lettering (a negative depth is embossed) and the smallest ``fillet``,
    relative to the diagonal of the box before the part is rotated.
    """

    kind: Literal["all", "plate", "bracket", "flange", "housing", "dial"] = "all"  # of part

    def __post_init__(self) -> None:
        expect_kind("kind", self.kind, KINDS)

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        rng = generator("parts", split, index)
        part, rotation = KINDS[kind](rng), random_rotation(rng)
        info = {
            "kind": kind,
            "genus": part.genus,
            "text": part.text,
            "height": float(part.height / part.size),
            "depth": float(part.depth / part.size),
            "stroke": float(part.stroke / part.size),
            "fillet": float(part.fillet / part.size),
        }
        return Shape(
            f"parts-{split}-{index:03d}-{kind}",
            lambda: turned(*arrays(part.build()), rotation),
            tags=(kind,),
            info=info,
            exactness="polyhedron",
        )
