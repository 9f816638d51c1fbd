"""Machine parts with sharp edges, holes and thin walls; the mesh is the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of
from .common.rotations import random_rotation
from .solids.parts import KINDS, Part

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("dataset", requires=("manifold3d", "trimesh"))
@dataclass(frozen=True)
class Cad(Family):
    """Machine parts by solid booleans: plates, brackets, gears, tees, heat sinks, blocks and lattices.

    Closed manifold meshes of one component, each kind in turn, each part with its own measures. Parts are rotated at
    random, since faces along the axes would favour methods that work on a grid.
    """

    kind: Literal["all", "plate", "bracket", "gear", "pipe_tee", "heat_sink", "block", "lattice"] = "all"  # of part

    def __post_init__(self) -> None:
        expect_kind("kind", self.kind, KINDS)

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        rng = generator("cad", split, index)
        part, rotation = KINDS[kind](rng), random_rotation(rng)
        thickness = part.thinnest / part.size
        info = {"kind": kind, "genus": part.genus, "thickness": thickness}
        id = f"cad-{split}-{index:03d}-{kind}"
        return Shape(id, lambda: _mesh(part, rotation), tags=(kind,), info=info, exactness="polyhedron")


def _mesh(part: Part, rotation: np.ndarray) -> Trimesh:
    from trimesh import Trimesh

    solid = part.build().to_mesh64()
    points = np.asarray(solid.vert_properties, dtype=np.float64)[:, :3]
    # einsum, not a matrix product: the sum is the same to the last bit with every linear algebra library.
    return Trimesh(np.einsum("ij,nj->ni", rotation, points), np.array(solid.tri_verts, dtype=np.int64), process=False)
