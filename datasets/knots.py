"""Knotted and linked tubes of constant radius, with a known gap between their strands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, log, pi, sqrt
from typing import Literal, NamedTuple

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of, spread
from .common.rotations import random_rotation
from .surfaces.tubes import FourierCurve, TubeSurface, circle, ellipse, nearest_approach, torus_knot

SLIM = 0.08  # least radius of the tubes of a chain: wide gaps need slim rings
TORUS_KNOTS = ((2, 3), (3, 2), (2, 5), (3, 4), (3, 5), (2, 7), (5, 2), (4, 3))


class Strands(NamedTuple):
    """Curves, the radius of the tubes around them, and the gap that this leaves."""

    curves: list[FourierCurve]
    radius: float
    gap: float
    facts: dict[str, object]

    @property
    def diagonal(self) -> float:
        """The diagonal of the bounding box of the tubes."""
        s = np.linspace(0, 2 * pi, 721)
        points = np.vstack([curve.at(s)[0] for curve in self.curves])
        return float(np.linalg.norm(np.ptp(points, axis=0) + 2 * self.radius))


def _filled(curves: list[FourierCurve], gap: float, facts: dict[str, object]) -> Strands:
    """The thickest tubes that leave the gap, a fraction of the diagonal, but no thicker than bends allow."""
    nearest = nearest_approach(curves)
    # 80 % of the least radius of curvature keeps the inside of bends from creasing.
    largest = 0.8 / max(curve.curvature for curve in curves)
    radius = min(nearest / 2, largest)
    for _ in range(2):  # the diagonal depends a little on the radius
        radius = min((nearest - gap * Strands(curves, radius, 0, {}).diagonal) / 2, largest)
    return Strands(curves, radius, nearest - 2 * radius, facts)


def _torus_knot(rng: np.random.Generator, gap: float) -> Strands:
    p, q = TORUS_KNOTS[rng.integers(len(TORUS_KNOTS))]
    knot = torus_knot(p, q, rng.uniform(0.36, 0.5), bulge=rng.uniform(0.9, 1.3))
    return _filled([knot], gap, {"p": p, "q": q, "symmetry": f"rotation {q} about an axis"})


def _figure_eight(rng: np.random.Generator, gap: float) -> Strands:
    """The knot 4_1: ``((2 + cos 2 s) cos 3 s, (2 + cos 2 s) sin 3 s, h sin 4 s)``."""
    height = rng.uniform(0.9, 1.5)
    knot = FourierCurve(
        np.array([3, 5, 1, 4]),
        np.array([[2, 0, 0], [0.5, 0, 0], [0.5, 0, 0], [0, 0, 0]]),
        np.array([[0, 2, 0], [0, 0.5, 0], [0, 0.5, 0], [0, 0, height]]),
    )
    return _filled([knot], gap, {"symmetry": "rotation 2 about an axis"})


def _chain(rng: np.random.Generator, gap: float) -> Strands:
    """Round rings in a row; each hangs taut in the previous one, up to the gap."""
    rings, radius = int(rng.integers(3, 7)), float(rng.uniform(0.16, 0.34))
    turns = np.cumsum(pi / 2 + rng.uniform(-0.3, 0.3, size=rings))
    # Rings that cross at about right angles are nearest on the axis of the chain, 2 - shift apart.
    across = [2 * float(np.abs(side(turns)).max()) + 2 * radius for side in (np.cos, np.sin)]
    shift = 2 - 2 * radius
    for _ in range(8):  # the diagonal depends a little on the gap
        along = 2 + (rings - 1) * shift + 2 * radius
        apart = min(gap * sqrt(across[0] ** 2 + across[1] ** 2 + along**2), 2 / 3 - 2 * SLIM)
        # A ring and the next but one lie in nearly the same plane: 2 shift - 2 - 2 radius must leave the gap.
        radius = min(radius, 1 / 3 - apart / 2)
        shift = 2 - 2 * radius - apart
    curves = [_ring(turn, k * shift) for k, turn in enumerate(turns)]
    return Strands(curves, radius, 2 - shift - 2 * radius, {"rings": rings, "symmetry": "rotation 2 about an axis"})


def _ring(turn: float, shift: float) -> FourierCurve:
    c, s = np.cos(turn), np.sin(turn)
    return circle().moved(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), np.array([shift, 0, 0]))


def _borromean(rng: np.random.Generator, gap: float) -> Strands:
    """Three ellipses in the coordinate planes; no two are linked, all three are."""
    link = ellipse(1.0, rng.uniform(0.5, 0.66))
    cycle = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    curves = [link.moved(turn, np.zeros(3)) for turn in (np.eye(3), cycle, cycle @ cycle)]
    return _filled(curves, gap, {"rings": 3, "symmetry": "pyritohedral"})


KINDS: dict[str, Callable[[np.random.Generator, float], Strands]] = {
    "torus_knot": _torus_knot,
    "chain": _chain,
    "borromean": _borromean,
    "figure_eight": _figure_eight,
}


@register("dataset", requires=("scipy", "trimesh"))
@dataclass(frozen=True)
class Knots(Family):
    """Tubes around torus knots, chains of rings, Borromean rings and the figure-eight knot; near contacts.

    All points at one distance from closed curves, one torus for each curve: exact samples, normals and closest points.
    Each kind in turn, rotated at random. The logarithm of the gap between the strands, as a fraction of the bounding
    box's diagonal, is spread evenly between two limits by a golden-ratio sequence; the tubes are as thick as the gap
    allows, unless they would crease in bends.
    """

    kind: Literal["all", "torus_knot", "chain", "borromean", "figure_eight"] = "all"  # of knot or link
    gap_low: float = 0.004  # narrowest gap between strands, as a fraction of the bounding box's diagonal
    gap_high: float = 0.06  # widest requested gap; tubes that are limited by bends leave a wider one

    def __post_init__(self) -> None:
        expect_kind("kind", self.kind, KINDS)
        if not 0.0005 <= self.gap_low <= self.gap_high:
            raise ValueError(f"gap_low: expected 0.0005 to gap_high={self.gap_high}, got {self.gap_low}")
        if not self.gap_high <= 0.08:
            raise ValueError(f"gap_high: expected at most 0.08, got {self.gap_high}")

    def _shape(self, split: str, index: int) -> Shape:
        kind = kind_of(self.kind, KINDS, index)
        rng = generator("knots", split, index)
        gap = exp(log(self.gap_low) + log(self.gap_high / self.gap_low) * spread(index))
        strands, rotation = KINDS[kind](rng, gap), random_rotation(rng)
        turned = [curve.moved(rotation, np.zeros(3)) for curve in strands.curves]
        surface = TubeSurface(lambda: (turned, strands.radius))
        diagonal = strands._replace(curves=turned).diagonal
        thickness, gap = 2 * strands.radius / diagonal, strands.gap / diagonal
        return Shape(
            f"knots-{split}-{index:03d}-{kind}",
            lambda: surface.mesh,
            surface=surface,
            tags=(kind,),
            info={"kind": kind, "genus": len(turned), "thickness": thickness, "gap": gap, **strands.facts},
            exactness="analytic" if kind == "chain" else "parametric",
        )
