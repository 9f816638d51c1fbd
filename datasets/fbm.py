"""Bodies with a rough skin: fractal noise along the normal of a smooth base, known exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import Literal

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, expect_kind, kind_of, spread
from .common.rotations import random_rotation
from .surfaces.gradient_noise import FractalNoise
from .surfaces.jets import Jet, cos, normalize, sin, stack
from .surfaces.parametric import Chart, ParametricSurface, Patch

BASES = ("sphere", "torus", "box", "ellipsoid")
ROUGH = 0.75  # below this Hurst exponent, detail is visible at every scale
BeforeNoise = Callable[[Jet, Jet], tuple[Jet, Jet]]  # the base's point and its outward unit normal


@register("dataset", requires=("igl", "scipy", "trimesh"))
@dataclass(frozen=True)
class Fbm(Family):
    """Spheres, tori, rounded boxes and ellipsoids, displaced along their normals by fractal noise.

    The surface is ``b + h(b) n`` with ``h`` the sum over octaves k of ``2^(-k hurst) noise(2^k b)`` (approximate
    fractional Brownian motion). Hurst exponents are spread evenly between the limits, from rough to gently wavy;
    ``fine`` in the info: whether there is detail at every scale (an exponent below 0.75 and three octaves or more). The
    largest possible |h| is ``strength``, below 1, times the base's reach (the distance up to which normals do not
    meet), so that no shape touches itself. Noise is twice continuously differentiable.
    """

    octaves: int = 4  # of noise, each half as wide as the one before
    frequency: float = 1.6  # of the first octave: cells of the noise per unit, bodies are about 2 across
    hurst_low: float = 0.3  # Hurst exponent of the roughest shapes
    hurst_high: float = 1.1  # and of the smoothest
    strength: float = 0.9  # largest possible displacement divided by the base's reach
    base: Literal["all", "sphere", "torus", "box", "ellipsoid"] = "all"  # of the displacement
    cells: int = 96  # of the tessellation across each sixth of a ball; a torus has 4 times as many around

    def __post_init__(self) -> None:
        if not 1 <= self.octaves <= 8:
            raise ValueError(f"octaves: expected 1 to 8, got {self.octaves}")
        if not 0.1 <= self.frequency <= 16:
            raise ValueError(f"frequency: expected 0.1 to 16, got {self.frequency}")
        if not 0 <= self.hurst_low <= self.hurst_high:
            raise ValueError(f"hurst_low: expected 0 to hurst_high={self.hurst_high}, got {self.hurst_low}")
        if not 0 <= self.strength < 1:
            raise ValueError(f"strength: expected 0 to below 1, got {self.strength}")
        expect_kind("base", self.base, BASES)
        if not 4 <= self.cells <= 512:
            raise ValueError(f"cells: expected 4 to 512, got {self.cells}")

    def _shape(self, split: str, index: int) -> Shape:
        rng = generator("fbm", split, index)
        hurst = self.hurst_low + (self.hurst_high - self.hurst_low) * spread(index, 0.1)
        base = kind_of(self.base, BASES, index)
        rough = Rough(base, hurst, self, int(rng.integers(2**31)))
        surface = ParametricSurface(rough.parts, random_rotation(rng), refine=True)
        info = {
            "base": base,
            "genus": int(base == "torus"),
            "symmetry": "none",
            "octaves": self.octaves,
            "hurst": hurst,
            "fine": hurst < ROUGH and self.octaves >= 3,
            "largest_displacement": rough.amplitude,
        }
        name = f"fbm-{split}-{index:03d}-{base}"
        return Shape(name, surface.mesh, surface=surface, tags=(base,), info=info, exactness="parametric")


@dataclass(frozen=True, eq=False)
class Rough:
    """One displaced base; the noise is made on first use."""

    base: str
    hurst: float
    settings: Fbm
    seed: int

    @cached_property
    def _measures(self) -> tuple[np.ndarray, float, float]:
        """Semi-axes (a torus: radius and tube), the exponent of the ball's norm, and the reach."""
        rng = generator("fbm base", self.seed)
        if self.base == "torus":
            tube = rng.uniform(0.32, 0.42)
            return np.array([1.0, tube]), 2.0, float(min(tube, 1 - tube))
        if self.base == "sphere":
            return np.ones(3), 2.0, 0.3  # its reach is 1; more than 0.3 would be a spiky star
        axes = np.sort(rng.uniform([0.55, 0.75, 1.0], [0.75, 1.0, 1.2]))
        if self.base == "ellipsoid":
            return axes, 2.0, float(min(axes[0] ** 2 / axes[2], 0.3))
        # On the unit ball of the 4-norm curvatures are below 2.6 (2.52 half-way between two axes, 2.28 between
        # three). A linear map with the singular values a makes them at most max a / min a^2 times as large.
        axes = np.array([0.85, 0.95, 1.0]) * rng.uniform(0.97, 1.03, size=3)
        return axes, 4.0, float(axes.min() ** 2 / axes.max() / 2.6)

    @property
    def amplitude(self) -> float:
        """The largest possible displacement."""
        return self.settings.strength * self._measures[2]

    @cached_property
    def _noise(self) -> FractalNoise:
        s = self.settings
        return FractalNoise(s.octaves, self.hurst, s.frequency, generator("fbm noise", self.seed))

    def parts(self) -> tuple[list[Chart], list[Patch]]:
        """A chart for each side of a cube, or one for a torus."""
        n = self.settings.cells
        if self.base == "torus":
            u, v = (np.linspace(-pi, pi, cells + 1) for cells in (2 * n, 4 * n))
            return [Chart(self._displaced(self._torus), flip=True)], [Patch(0, u, v, reach=(2 * pi, 2 * pi))]
        lines = np.linspace(-1, 1, n + 1)
        sides = [(axis, sign) for axis in range(3) for sign in (1.0, -1.0)]
        charts = [Chart(self._displaced(self._side(axis, sign)), flip=sign < 0) for axis, sign in sides]
        return charts, [Patch(k, lines, lines, reach=(0.2, 0.2)) for k in range(6)]

    def _displaced(self, base: BeforeNoise) -> Callable[[Jet, Jet], Jet]:
        def position(u: Jet, v: Jet) -> Jet:
            point, normal = base(u, v)
            return point + normal * (self._noise(point) * self.amplitude)

        return position

    def _torus(self, u: Jet, v: Jet) -> tuple[Jet, Jet]:
        radius, tube = self._measures[0]
        normal = stack(cos(u) * cos(v), cos(u) * sin(v), sin(u))
        return stack(cos(v) * radius, sin(v) * radius, 0.0 * u) + normal * tube, normal

    def _side(self, axis: int, sign: float) -> BeforeNoise:
        """The part of the ball ``sum |x/a|^p = 1`` over a side of the cube, in equal angles."""
        axes, p, _ = self._measures

        def part(u: Jet, v: Jet) -> tuple[Jet, Jet]:
            across = [sin(t * (pi / 4)) / cos(t * (pi / 4)) for t in (u, v)]
            placed: list[Jet | float] = [across[0], across[1], sign]
            x, y, z = [*placed[2 - axis :], *placed[: 2 - axis]]
            d = stack(x, y, z)  # u, v and the axis in cyclic order: x_u cross x_v is along it
            norm = sum((d[k] ** p for k in range(3)), start=0.0)
            unit = d * norm ** (-1 / p)
            gradient = unit ** (p - 1)
            inverse = (1 / axes)[:, None]
            return unit * axes[:, None], normalize(gradient * inverse)

        return part
