"""Vases, bowls, bottles and beakers: turned or fluted, with a wall of constant thickness, or as one open sheet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from math import pi

import numpy as np

from bench import Shape, ShapePair, generator, register

from .common.family import Family, spread
from .common.rotations import random_rotation
from .surfaces.jets import Jet, abs_power, cos, sin, smooth_step, stack
from .surfaces.parametric import Chart, ParametricSurface, Patch
from .surfaces.patch_mesh import graded_lines, pole_levels
from .surfaces.shells import offset, round_end
from .surfaces.splines import Profile

ROWS = 11  # control points above the foot

# Height, and radii at relative heights from the foot to the lip.
KINDS = {
    "vase": (1.9, [(0, 0.38), (0.2, 0.55), (0.45, 0.78), (0.65, 0.55), (0.82, 0.3), (1, 0.44)]),
    "bowl": (0.8, [(0, 0.4), (0.25, 0.66), (0.5, 0.86), (0.8, 0.97), (1, 1.0)]),
    "beaker": (1.5, [(0, 0.5), (0.3, 0.46), (0.6, 0.5), (0.85, 0.58), (1, 0.68)]),
    "bottle": (2.2, [(0, 0.5), (0.2, 0.56), (0.5, 0.54), (0.7, 0.24), (0.85, 0.19), (1, 0.2)]),
}
SECTIONS = ("flutes", "polygon", "round")


@register("dataset", requires=("igl", "scipy", "trimesh"))
@dataclass(frozen=True)
class Vases(Family):
    """Hollow vessels with a real rim; exact samples, normals and closest points.

    A profile, a quintic spline from the middle of the foot to the lip, is revolved; above the foot its section blends
    from a circle to flutes or to a twisted polygon with round edges. The wall is this surface moved exactly by half its
    thickness to either side, and ends in a half-round rim. The thickness of the shapes is spread evenly over the range.
    Every fourth shape is a single sheet with a true border at the lip. ``pairs`` are upright, z up, all closed, and
    independent: kinds and sections of the two are drawn separately.
    """

    thickness_low: float = 0.008  # approximate thinnest wall, as a fraction of the bounding-box diagonal
    thickness_high: float = 0.045  # thickest wall
    columns: int = 256  # cells of the tessellation around

    def __post_init__(self) -> None:
        if not 0.001 <= self.thickness_low <= 0.05:
            raise ValueError(f"thickness_low: expected 0.001 to 0.05, got {self.thickness_low}")
        if not self.thickness_low <= self.thickness_high <= 0.05:
            raise ValueError(
                f"thickness_high: expected thickness_low={self.thickness_low} to 0.05, got {self.thickness_high}"
            )
        if not 32 <= self.columns <= 4096 or self.columns % 16:
            raise ValueError(f"columns: expected a multiple of 16 from 32 to 4096, got {self.columns}")

    def _shape(self, split: str, index: int) -> Shape:
        rng = generator("vases", split, index)
        share = spread(index, 0.25)
        relative = self.thickness_low * (self.thickness_high / self.thickness_low) ** share
        kind, section = list(KINDS)[index % 4], SECTIONS[(index + index // 4) % 3]
        single = (index % 4 + index // 4) % 4 == 2
        vessel = Vessel(kind, section, relative, single, self.columns, int(rng.integers(2**31)))
        return self._made(f"vases-{split}-{index:03d}-{kind}", vessel, random_rotation(rng))

    def pairs(self, split: str) -> Iterator[ShapePair]:
        """Two upright vessels, drawn independently."""
        for index in count():
            rng = generator("vases pairs", split, index)
            id = f"vases-{split}-{index:03d}"
            made: list[Shape] = []
            for name in ("source", "target"):
                kind, section = (str(rng.choice(names)) for names in (list(KINDS), SECTIONS))
                relative = self.thickness_low * (self.thickness_high / self.thickness_low) ** rng.random()
                vessel = Vessel(kind, section, relative, False, self.columns, int(rng.integers(2**31)))
                made.append(self._made(f"{id}-{name}", vessel, np.eye(3)))
            source, target = made
            yield ShapePair(id, source, target, corresponding=False)

    def _made(self, name: str, vessel: Vessel, rotation: np.ndarray) -> Shape:
        surface = ParametricSurface(vessel.parts, rotation)
        info = {"kind": vessel.kind, "section": vessel.section, "genus": 0}
        if not vessel.single:
            # Half the thickness is added on each side of the middle surface, which `relative` refers to.
            info["thickness"] = vessel.thickness / vessel.diagonal
            info["wall"] = vessel.thickness
        info["symmetry"] = vessel.symmetry
        return Shape(name, surface.mesh, surface=surface, tags=(vessel.kind,), info=info, exactness="parametric")


@dataclass(frozen=True, eq=False)
class Vessel:
    """One vessel, drawn from its seed on first use."""

    kind: str
    section: str
    relative: float  # thickness over the diagonal of the middle surface
    single: bool  # one sheet, without thickness
    columns: int
    seed: int

    @cached_property
    def _drawn(self) -> tuple[np.ndarray, int, float, float]:
        """Control points, lobes, their depth, and the twist in radians."""
        rng = generator("vessel", self.seed)
        height, radii = KINDS[self.kind]
        height *= rng.uniform(0.9, 1.1)
        at, r = np.array(radii).T
        r = r * rng.uniform(0.9, 1.1, size=len(r))
        z = np.linspace(0, 1, ROWS + 1)[1:]
        foot = r[0] * np.arange(5) / 4
        controls = np.concatenate(
            [np.stack([foot, 0 * foot], axis=1), np.stack([np.interp(z, at, r), height * z], axis=1)]
        )
        lobes = int(rng.integers(5, 10)) if self.section == "flutes" else int(rng.integers(3, 7))
        depth = rng.uniform(0.6, 1.0) * (1.6 / lobes**2 if self.section == "flutes" else 0.85)
        twist = rng.uniform(0.3, 1.2) * rng.choice([-1, 1])
        return controls, lobes, float(depth), float(twist)

    @cached_property
    def profile(self) -> Profile:
        """The profile of the middle surface."""
        return Profile(self._drawn[0])

    @property
    def symmetry(self) -> str:
        """In words."""
        return "revolution about an axis" if self.section == "round" else f"rotation {self._drawn[1]} about an axis"

    @cached_property
    def _extents(self) -> np.ndarray:
        """Of the middle surface, (3,), to about a thousandth."""
        u, v = (m.ravel() for m in np.meshgrid(np.linspace(1e-3, 1, 41), np.linspace(-pi, pi, 121)))
        return np.ptp(self.middle(*Jet.variables(u, v, 0)).value, axis=1)

    @cached_property
    def diagonal(self) -> float:
        """Of the bounding box, of the solid where there is a wall."""
        return float(np.linalg.norm(self._extents + (0.0 if self.single else self.thickness)))

    @cached_property
    def thickness(self) -> float:
        """Of the wall."""
        return self.relative * float(np.linalg.norm(self._extents))

    def middle(self, t: Jet, w: Jet) -> Jet:
        """The middle of the wall, t from the middle of the foot to the lip, w around."""
        r, z = self.profile(t)
        _, lobes, depth, twist = self._drawn
        if self.section != "round":
            blend = smooth_step((t - 0.3) / 0.45)
            turned = w + t * twist
            shape = cos(turned * lobes) * depth if self.section == "flutes" else (_polygon(turned, lobes) - 1) * depth
            r = r * (1 + blend * shape)
        return stack(r * cos(w), r * sin(w), z)

    def parts(self) -> tuple[list[Chart], list[Patch]]:
        """The outer and the inner wall, and the rim between them; or the sheet alone."""
        dense = np.linspace(0, 1, 4001)
        points = self.profile.points(dense)
        length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        rows = round(0.7 * self.columns * length / (2 * pi * points[:, 0].max()) / 2) * 2 + 40
        t = graded_lines(points, dense, rows, turning=0.3)
        w = np.linspace(-pi, pi, self.columns + 1)
        at = self.profile.points(t)
        steps = np.linalg.norm(np.diff(at, axis=0), axis=1)
        levels = pole_levels(np.abs(at[:, 0]) * (w[1] - w[0]), np.append(steps, steps[-1]), self.columns)
        levels = np.where(t > 0.3, 0, levels)  # only the foot gets fewer columns, a slim neck does not
        wall = (0.0, 2 * pi)
        if self.single:
            return [Chart(self.middle, flip=True)], [Patch(0, t, w, levels, wall)]
        half = self.thickness / 2
        outer, inner = (offset(self.middle, side * half, pole=1e-6) for side in (-1, 1))  # x_t cross x_w points inside
        rim = round_end(self.middle, at=1.0, axis=0, outward=1.0, half=half)
        s = np.linspace(-pi / 2, pi / 2, 13)
        charts = [Chart(outer, flip=True, lost=1), Chart(inner, lost=1), Chart(rim, flip=True, lost=1)]
        return charts, [Patch(0, t, w, levels, wall), Patch(1, t, w, levels, wall), Patch(2, s, w, None, wall)]


def _polygon(w: Jet, corners: int) -> Jet:
    """The radius of a regular polygon with round corners over the angle w, about 1 at the middles of its sides."""
    total = 0.0 * w
    for k in range(corners):
        c = cos(w - 2 * pi * k / corners)
        total = total + abs_power(Jet(c.c * (c.value > 0)), 12.0)
    return total ** (-1 / 12)
