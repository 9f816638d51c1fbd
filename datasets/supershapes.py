"""Supershapes of two superformulas: stars, flowers, gears and lanterns, known exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, spread
from .common.rotations import random_rotation
from .surfaces.parametric import ParametricSurface
from .surfaces.spherical_product import SphericalProduct, Superformula, check_grid

KINDS = ("star", "flower", "ridged", "lantern")


@register("dataset", requires=("igl", "scipy", "trimesh"))
@dataclass(frozen=True)
class Supershapes(Family):
    """Gielis' supershapes: the spherical product of two superformulas; exact samples, normals and closest points.

    Each formula is ``r(t) = (|cos(m t / 4)|^p + |sin(m t / 4)|^p)^(-1 / q)``. With p below 2 its m tips are pointed
    (at p = 1 they are edges), above 2 they are rounded lobes with valleys between. ``q`` is chosen so that the largest
    radius is ``2^depth`` times the smallest. In turn: stars (pointed tips), flowers (round lobes), ridged ones (many
    shallow pointed ridges) and lanterns (pointed around, lobed from pole to pole). ``sharpest_turn`` in the info: the
    largest rotation of the normal, in degrees, within 2 % of the bounding-box diagonal. Shapes are rotated at random.
    """

    lobes_low: int = 3  # fewest lobes around
    lobes_high: int = 9  # most lobes around
    depth: float = 0.9  # of the deepest valleys: radii vary by a factor of 2^depth
    rows: int = 160  # cells of the tessellation from pole to pole
    columns: int = 288  # cells around

    def __post_init__(self) -> None:
        if not 2 <= self.lobes_low <= 24:
            raise ValueError(f"lobes_low: expected 2 to 24, got {self.lobes_low}")
        if not self.lobes_low <= self.lobes_high <= 24:
            raise ValueError(f"lobes_high: expected lobes_low={self.lobes_low} to 24, got {self.lobes_high}")
        if not 0.05 <= self.depth <= 1.5:
            raise ValueError(f"depth: expected 0.05 to 1.5, got {self.depth}")
        check_grid(self.rows, self.columns)

    def _shape(self, split: str, index: int) -> Shape:
        rng = generator("supershapes", split, index)
        lobes = self.lobes_low + int((self.lobes_high - self.lobes_low + 1) * spread(index, 0.4))
        kind = KINDS[index % len(KINDS)]
        longitude, latitude = _formulas(kind, lobes, self.depth, rng)
        axes = (1.0, 1.0, float(rng.uniform(0.6, 1.1)))
        product = SphericalProduct(latitude, longitude, axes, 0.0, self.rows, self.columns)
        surface = ParametricSurface(product.parts, random_rotation(rng))
        turn = product.sharpest_turn()
        info = {
            "kind": kind,
            "genus": 0,
            "symmetry": f"rotation {lobes} about z, mirror z, before the turn at random",
            "lobes": lobes,
            "longitude": [longitude.m, longitude.n1, longitude.n2],
            "latitude": [latitude.m, latitude.n1, latitude.n2],
            "sharpest_turn": round(turn, 1),
        }
        name = f"supershapes-{split}-{index:03d}-{kind}"
        return Shape(name, surface.mesh, surface=surface, tags=(kind,), info=info, exactness="parametric")


def _formulas(kind: str, lobes: int, depth: float, rng: np.random.Generator) -> tuple[Superformula, Superformula]:
    """The superformulas of longitude and latitude."""
    x, y = rng.uniform(0.75, 1.0, size=2)
    pointed, lobed = float(rng.choice([1.0, 1.15, 1.3])), rng.uniform(3.0, 7.0)
    if kind == "star":
        return _formula(lobes, pointed, depth * x), _formula(4, rng.uniform(1.0, 1.4), 0.5 * depth * y)
    if kind == "flower":
        return _formula(lobes, lobed, depth * x), _formula(int(rng.choice([2, 4])), 3.0, 0.35 * depth * y)
    if kind == "ridged":
        return _formula(2 * lobes, pointed, 0.3 * depth * x), _formula(2, rng.uniform(2.5, 5), 0.5 * depth * y)
    return _formula(lobes, pointed, 0.6 * depth * x), _formula(6, lobed, 0.6 * depth * y)


def _formula(m: int, p: float, depth: float) -> Superformula:
    """Where |cos| = |sin|, ``r = 2^((p / 2 - 1) / q)``, and 1 where one of them is 0."""
    return Superformula(m, float(abs(p / 2 - 1) / depth), float(p), float(p))
