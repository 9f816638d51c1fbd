"""Reliefs and engravings: a known displacement of a known base, and the same displacement on another base."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from math import pi
from typing import TYPE_CHECKING, Literal

import numpy as np

from bench import Shape, ShapePair, generator, register

from .common.rotations import random_rotation
from .details.patterns import Pattern, hexagons, knurl, letters, weave
from .details.relief_bases import BALL_BAND, Base, band_mask, draw_ball, draw_ring, draw_vase
from .surfaces.jets import Jet, unit_normal
from .surfaces.parametric import Chart, ParametricSurface, Patch

if TYPE_CHECKING:
    from trimesh import Trimesh

BASES = {"ball": draw_ball, "vase": draw_vase, "ring": draw_ring}
PATTERNS = ("hexagons", "letters", "knurl", "weave")
AMPLITUDES = (1e-1, 1e-2, 1e-3)
PERIODS = {1e-1: 5, 1e-2: 18, 1e-3: 36}  # of a pattern around the body: it gets finer as it gets lower
HIGH = 10  # patterns with fewer periods have the highest amplitude
FINE = 0.12  # a pattern with a period below this fraction of the diagonal has a finer scale than its base


@register("dataset", requires=("igl", "scipy", "trimesh"))
@dataclass(frozen=True)
class Reliefs:
    """Honeycombs, letters, knurls and weaves embossed on, or engraved into, smooth bases; all is known exactly.

    A shape is ``b(u, v) + h(u, v) n(u, v)`` with a base b, its unit normal n, and a height h that ranges over 1e-1,
    1e-2 or 1e-3 of the base's bounding-box diagonal, in turn. The attributes ``base_vertices``, ``base_normals`` (v, 3)
    and ``displacement`` (v,) belong to the mesh: its vertices are ``base_vertices + displacement * base_normals``.
    ``pairs`` gives the ground truth of a detail transfer: source and target have the same displacement at the same
    (u, v), on two bases. A ball's and a vase's normals differ at the same (u, v), by more than a period of a fine
    pattern: for methods that are defined for roughly aligned shapes, ``targets=alike`` draws the target's base from
    the source's own family.

    The highest reliefs point outwards, lower ones outwards or inwards.
    """

    cells: int = 512  # of the tessellation around the body: the finest pattern has 36 periods
    amplitude: float = 0.0  # of all reliefs, relative to the base's diagonal: 0.1, 0.01 or 0.001; 0 for each in turn
    targets: Literal["other", "alike"] = "other"  # transfer between balls and vases, or within one family of bases

    def __post_init__(self) -> None:
        if not 32 <= self.cells <= 4096 or self.cells % 16:
            raise ValueError(f"cells: expected a multiple of 16 from 32 to 4096, got {self.cells}")
        if self.amplitude and self.amplitude not in AMPLITUDES:
            raise ValueError(f"amplitude: expected 0.1, 0.01, 0.001, or 0 for each in turn, got {self.amplitude}")

    def shapes(self, split: str) -> Iterator[Shape]:
        """The endless shapes of a split; ``train`` and ``test`` come from different seeds."""
        for index in count():
            yield _shape(f"reliefs-{split}-{index:03d}", *self._draw(split, index)[:2])

    def pairs(self, split: str) -> Iterator[ShapePair]:
        """Pairs with the displacement of shape number i: on its own base (source) and on another base (target)."""
        for index in count():
            info, source, target = self._draw(split, index)
            id = f"reliefs-{split}-{index:03d}"
            yield ShapePair(id, _shape(f"{id}-source", info, source), _shape(f"{id}-target", info, target))

    def _draw(self, split: str, index: int) -> tuple[dict, Relief, Relief]:
        rng = generator("reliefs", split, index)
        amplitude, pattern = self.amplitude or AMPLITUDES[index % 3], PATTERNS[index % 4]
        kind = list(BASES)[(index + index // 3) % 3]
        # A ball and a vase have the same parameters: each can be the other's target.
        other = {"ball": "vase", "vase": "ball", "ring": "ring"}[kind]
        base, target = BASES[kind](rng), BASES[other if self.targets == "other" else kind](rng)
        around = round(PERIODS[amplitude] * rng.uniform(0.85, 1.15))
        sign = 1.0 if amplitude == AMPLITUDES[0] else float(rng.choice([-1.0, 1.0]))
        seed = int(rng.integers(2**31))
        first, second = (
            Relief(b, pattern, sign * amplitude * base.diagonal, around, base.aspect, seed, self.cells, turned)
            for b, turned in ((base, random_rotation(rng)), (target, random_rotation(rng)))
        )
        info = {
            "base": kind,
            "pattern": pattern,
            "amplitude": amplitude,
            "engraved": sign < 0,
            "periods": around,
            "genus": int(kind == "ring"),
            "symmetry": "none",
        }
        return info, first, second


@dataclass(frozen=True, eq=False)
class Relief:
    """One displacement on one base; everything is made on first use."""

    base: Base
    pattern: str
    height: float  # the largest displacement, negative for engravings
    around: int  # number of periods around the body
    aspect: float  # of the base that the pattern is made for; the number of periods along u makes it even there
    seed: int
    cells: int
    rotation: np.ndarray

    @cached_property
    def _pattern(self) -> Pattern:
        n = self.around
        # Periods over 2 pi of u for cells about as high as wide.
        across = self.aspect * n
        high = n < HIGH  # a high relief has flatter flanks: otherwise studs and grooves would be towers and clefts
        if self.pattern == "hexagons":
            return hexagons(max(2, round(across * 3**0.5 / 2)), max(2, round(n / 2)), 0.3 if high else 0.55)
        if self.pattern == "knurl":
            return knurl(max(2, round(0.6 * across)), n, 1.0 if high else 2.2)
        if self.pattern == "weave":
            return weave(max(2, 2 * round(across / 2)), max(2, 2 * round(n / 2)))
        columns = max(5, round(0.5 * n))
        return letters(max(3, round(columns * self.aspect / 1.4)), columns, generator("letters", self.seed))

    def displacement(self, u: Jet, v: Jet) -> Jet:
        """The displacement at (u, v)."""
        h = self._pattern(u, v) * self.height
        return h if self.base.is_ring else h * band_mask(u)

    def _position(self, u: Jet, v: Jet) -> Jet:
        # At the poles, where the displacement is 0, the normal is taken a little beside them.
        beside = u if self.base.is_ring else u + (np.clip(u.value, -BALL_BAND, BALL_BAND) - u.value)
        below = u.order - 1
        h = self.displacement(u.truncate(below), v.truncate(below))
        return self.base.position(u, v) + unit_normal(self.base.position(beside, v)) * (h * self.base.side)

    @cached_property
    def surface(self) -> ParametricSurface:
        """The detailed surface."""
        chart = Chart(self._position, flip=self.base.side < 0, lost=1)
        return ParametricSurface(lambda: ([chart], [self._patch]), self.rotation)

    @cached_property
    def bare(self) -> ParametricSurface:
        """The base."""
        chart = Chart(self.base.position, flip=self.base.side < 0)
        return ParametricSurface(lambda: ([chart], [self._patch]), self.rotation)

    @property
    def _patch(self) -> Patch:
        return self.base.patch(self.cells)

    @cached_property
    def attributes(self) -> dict[str, np.ndarray]:
        """Base vertices, base normals and displacement of the mesh."""
        welded, patch, u, v, _ = self.bare.grid
        at = welded.representative
        vertices, normals = self.bare.at(patch[at], u[at], v[at])
        h = self.displacement(*Jet.variables(u[at], v[at], 0)).value
        return {"base_vertices": vertices, "base_normals": normals, "displacement": h}

    def mesh(self) -> Trimesh:
        """The detailed mesh; its faces are the same on every base."""
        from trimesh import Trimesh

        known = self.attributes
        vertices = known["base_vertices"] + known["displacement"][:, None] * known["base_normals"]
        return Trimesh(vertices, self.faces, process=False)

    @cached_property
    def faces(self) -> np.ndarray:
        """Faces that do not depend on the base's form."""
        return self.bare.grid[0].faces


def _shape(id: str, info: dict, relief: Relief) -> Shape:
    period = 2 * pi * relief.base.width / relief.around / relief.base.diagonal
    fine = period < FINE and info["amplitude"] > AMPLITUDES[-1]
    info = {**info, "period": float(period), "fine": bool(fine)}
    return Shape(
        f"{id}-{info['pattern']}" if "pattern" in info and not id.endswith(("source", "target")) else id,
        relief.mesh,
        surface=relief.surface,
        tags=(info["pattern"],),
        info=info,
        exactness="parametric",
        attributes=lambda: relief.attributes,
    )
