"""Superellipsoids and supertoroids: from boxes over spheres to octahedra, known exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import Shape, generator, register

from .common.family import Family
from .common.rotations import random_rotation
from .surfaces.parametric import ParametricSurface
from .surfaces.spherical_product import SphericalProduct, Superformula, check_grid

# The two-dimensional golden ratio (Roberts 2018): pairs (e1, e2) that fill the square evenly from the first on. The
# start is chosen so that the first four are a box, an octahedron-like body, a wheel with an edge, and a square ring.
STEP = (0.7548776662466927, 0.5698402909980532)
START = (0.02, 0.03)
TOROIDS = 4  # every fourth shape is a supertoroid


@register("dataset", requires=("igl", "scipy", "trimesh"))
@dataclass(frozen=True)
class Superquadrics(Family):
    """Superellipsoids and supertoroids; exact samples, normals and closest points.

    The surface is ``((|x/a|^(2/e2) + |y/b|^(2/e2))^(e2/e1) + |z/c|^(2/e1) = 1`` (Barr 1981), parametrised by the polar
    angles of its two superellipses, so that tangents stay finite; every fourth shape is a ring with such a section.
    Small exponents give boxes with narrow rounds, 1 an ellipsoid, 2 an octahedron. The pairs (e1, e2) of the shapes
    fill the square between the limits evenly; an exponent of 2 gives a true edge. ``sharpest_turn`` in the info: the
    largest rotation of the normal, in degrees, within 2 % of the bounding-box diagonal. Shapes are rotated at random.
    """

    exponent_low: float = 0.1  # smallest exponent: 0.1 is a box with rounds of 7 % of its half width
    exponent_high: float = 2.0  # largest exponent: 2 is an octahedron
    kind: Literal["all", "ellipsoid", "toroid"] = "all"  # of body
    rows: int = 160  # cells of the tessellation from pole to pole
    columns: int = 256  # cells around

    def __post_init__(self) -> None:
        if not 0.05 <= self.exponent_low <= 2:
            raise ValueError(f"exponent_low: expected 0.05 to 2, got {self.exponent_low}")
        if not self.exponent_low <= self.exponent_high <= 2:
            raise ValueError(f"exponent_high: expected exponent_low={self.exponent_low} to 2, got {self.exponent_high}")
        if self.kind not in ("all", "ellipsoid", "toroid"):
            raise ValueError(f"kind: expected all, ellipsoid or toroid, got {self.kind!r}")
        check_grid(self.rows, self.columns)

    def _shape(self, split: str, index: int) -> Shape:
        rng = generator("superquadrics", split, index)
        ring = self.kind == "toroid" or (self.kind == "all" and index % TOROIDS == TOROIDS - 1)
        e1, e2 = (
            self.exponent_low + (self.exponent_high - self.exponent_low) * ((start + index * step) % 1)
            for start, step in zip(START, STEP, strict=True)
        )
        a, b, c = (float(x) for x in rng.uniform(0.4, 1.0, size=3))
        product = SphericalProduct(
            _superellipse(e1),
            _superellipse(e2),
            (a, b, c),
            float(rng.uniform(1.8, 3.0)) if ring else 0.0,
            self.rows,
            self.columns,
        )
        rotation = random_rotation(rng)
        surface = ParametricSurface(product.parts, rotation)
        turn = product.sharpest_turn()
        kind = "toroid" if ring else "ellipsoid"
        info = {
            "kind": kind,
            "genus": int(ring),
            "symmetry": "mirror x, y and z",
            "e1": float(e1),
            "e2": float(e2),
            "axes": list(product.axes),
            "major": product.major,
            "sharpest_turn": round(turn, 1),
            "rotation": np.round(rotation, 15).tolist(),
        }
        return Shape(
            f"superquadrics-{split}-{index:03d}-{kind}",
            surface.mesh,
            surface=surface,
            tags=(kind,),
            info=info,
            exactness="parametric",
        )


def _superellipse(e: float) -> Superformula:
    return Superformula(4, 2 / e, 2 / e, 2 / e)
