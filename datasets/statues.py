"""Statues: busts, draped figures and carved panels, with detail over three decades, known exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of
from .details.ornaments import weathering
from .details.strands import Carver
from .figures import busts, draped, panels
from .figures.hair import STYLES
from .surfaces.duals import Dual, Point
from .surfaces.implicit import Body, ImplicitSurface
from .surfaces.sculpting import Sculpture

Made = Callable[[Point], Dual]


@register("dataset", requires=("scipy", "skimage", "trimesh"))
@dataclass(frozen=True)
class Statues(Family):
    """Busts, draped figures and carved panels with detail over three decades; exact samples and closest points.

    Stand-ins for scans of sculptures. In turn a bust on its foot, a standing figure in dress and mantle, and a panel
    with a head in relief. Detail follows the form and its directions: strands of hair run from the crown, curls and
    beards grow where they grow on people, folds hang from shoulders and are tight over a knee, ornaments follow their
    frame. Relative to the radius, limbs and heads are about 0.3 in size, features 0.03, strands and folds from 0.03
    down to 0.003, and pores and tool marks 0.0005. A shape is one formula of x, y and z, smooth unions of primitives
    and displacements of them, whose gradients are exact. Upright, z up, facing -y.
    """

    kind: Literal["all", "bust", "figure", "relief"] = "all"  # of sculpture
    detail: float = 1.0  # height of hair, folds, ornaments and pores, as a multiple of the usual one; 0: forms only
    resolution: float = 110.0  # edges of the mesh along the radius; faces grow with its square

    def __post_init__(self) -> None:
        expect_kind("kind", self.kind, KINDS)
        if not 0 <= self.detail <= 1.2:
            raise ValueError(f"detail: expected 0 to 1.2, got {self.detail}")
        if not 40 <= self.resolution <= 1000:
            raise ValueError(f"resolution: expected 40 to 1000 edges along the radius, got {self.resolution}")

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        variant = index // (len(KINDS) if self.kind == "all" else 1)

        def body() -> Body:
            return self._body(generator("statues", split, index), kind, variant)

        surface = ImplicitSurface(body, refine=False)  # the grid resolves the carving; halving takes most of a minute
        return Shape(
            f"statues-{split}-{index:03d}-{kind}",
            lambda: surface.mesh,
            surface=surface,
            tags=(kind,),
            info={"kind": kind, "genus": 0, "symmetry": "none", "detail": self.detail},
            exactness="implicit",
        )

    def _body(self, rng: np.random.Generator, kind: str, variant: int) -> Body:
        low, high, size, make = KINDS[kind]
        made, carver = make(rng, variant, self.detail)

        def form(at: Point) -> Dual:
            body = made(at)
            return body - weathering(at, carver, size) * self.detail if self.detail else body

        return Body(Sculpture(form, SLOPE, np.eye(3)), np.array(low), np.array(high), size / self.resolution)


SLOPE = 2.6  # largest slope of the functions, except on rare flanks of ornaments and locks


def _bust(rng: np.random.Generator, variant: int, detail: float) -> tuple[Made, Carver]:
    it = busts.draw_bust(rng, STYLES[variant % len(STYLES)])
    carver = Carver(rng)
    return lambda at: busts.bust(at, it, carver, detail), carver


def _figure(rng: np.random.Generator, variant: int, detail: float) -> tuple[Made, Carver]:
    it = draped.draw_draped(rng, list(draped.STANCES)[variant % len(draped.STANCES)])
    carver = Carver(rng)
    return lambda at: draped.draped(at, it, carver, detail), carver


def _relief(rng: np.random.Generator, variant: int, detail: float) -> tuple[Made, Carver]:
    it = panels.draw_panel(rng)
    carver = Carver(rng)
    return lambda at: panels.panel(at, it, carver, detail), carver


KINDS = {
    "bust": ((-1.9, -1.5, -3.9), (1.9, 1.9, 1.7), busts.SIZE, _bust),
    "figure": ((-1.0, -0.95, -0.2), (1.0, 0.6, 2.2), draped.SIZE, _figure),
    "relief": ((-1.1, -1.1, -1.4), (1.1, 0.3, 1.4), panels.SIZE, _relief),
}
"""For each kind the corners of its box, its radius, and the function that makes it."""
