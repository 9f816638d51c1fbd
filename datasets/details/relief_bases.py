"""Smooth bases for reliefs, over latitude u and longitude v: balls, vases and rings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np

from ..surfaces.jets import Jet, cos, sin, smooth_step, stack
from ..surfaces.parametric import Patch
from ..surfaces.patch_mesh import pole_levels

BAND = 0.95  # latitude at which a relief has faded out; beyond it a ball is bare
FADE = 0.2  # over this angle
BALL_BAND = 1.4  # latitude beyond which the normal no longer matters to the relief


@dataclass(frozen=True, eq=False)
class Base:
    """A base, its formula and its approximate measures."""

    position: Callable[[Jet, Jet], Jet]
    is_ring: bool
    side: float  # the outward normal is side * x_u cross x_v
    width: float  # approximate radius at the equator
    aspect: float  # approximate length of a radian of u divided by that of a radian of v

    @cached_property
    def diagonal(self) -> float:
        """The diagonal of the bounding box."""
        u = np.linspace(-pi, pi, 121) if self.is_ring else np.linspace(-pi / 2, pi / 2, 61)
        u, v = (m.ravel() for m in np.meshgrid(u, np.linspace(-pi, pi, 121)))
        return float(np.linalg.norm(np.ptp(self.position(*Jet.variables(u, v, 0)).value, axis=1)))

    def patch(self, cells: int) -> Patch:
        """The grid of ``cells`` columns; it is the same for all balls and vases, and for all rings."""
        v = np.linspace(-pi, pi, cells + 1)
        if self.is_ring:
            return Patch(0, np.linspace(-pi, pi, 5 * cells // 16 + 1), v, reach=(2 * pi, 2 * pi), fixed=True)
        u = np.linspace(-pi / 2, pi / 2, cells // 2 + 1)
        spacing = np.full(len(u), u[1] - u[0])
        levels = pole_levels(np.cos(u) * (v[1] - v[0]), spacing, cells)
        return Patch(0, u, v, levels, reach=(0.0, 2 * pi), fixed=True)


def band_mask(u: Jet) -> Jet:
    """1 about the equator, 0 beyond the latitude where a relief ends."""
    return smooth_step((BAND - u) / FADE) * smooth_step((BAND + u) / FADE)


def draw_ball(rng: np.random.Generator) -> Base:
    """An egg or pebble: an ellipsoid, tapered, bent and slightly wavy."""
    a, b, c = rng.uniform([0.85, 0.75, 0.9], [1.05, 0.95, 1.15])
    taper, bend, wave, phase = rng.uniform([-0.2, -0.15, 0.0, 0], [0.2, 0.15, 0.04, 2 * pi])
    return _revolved((a, b, c), lambda z: 1 + taper * z + wave * sin(z * 4 + phase), bend)


def draw_vase(rng: np.random.Generator) -> Base:
    """A body with a waist and a belly, like a closed jar."""
    a, b = rng.uniform([0.7, 0.65], [0.8, 0.8])
    height, depth, phase = rng.uniform([1.3, 0.14, 0], [1.6, 0.22, 2 * pi])
    bend = rng.uniform(-0.12, 0.12)
    return _revolved((a, b, height), lambda z: 1 + depth * sin(z * 3.2 + phase), bend)


def _revolved(axes: tuple[float, float, float], profile: Callable[[Jet], Jet], bend: float) -> Base:
    a, b, c = axes

    def position(u: Jet, v: Jet) -> Jet:
        z, across = sin(u), cos(u)
        f = profile(z)
        return stack(a * f * across * cos(v) + bend * z * z, b * f * across * sin(v), c * z)

    return Base(position, False, -1.0, (a + b) / 2, 2 * c / (a + b))


def draw_ring(rng: np.random.Generator) -> Base:
    """An elongated ring of varying thickness that is not flat."""
    tube, stretch, swell, lift = rng.uniform([0.33, 0.9, 0.0, 0.0], [0.4, 1.0, 0.15, 0.15])
    waves, phase = int(rng.integers(2, 4)), rng.uniform(0, 2 * pi)

    def position(u: Jet, v: Jet) -> Jet:
        r = tube * (1 + swell * cos(v * waves + phase))
        across = 1 + r * cos(u)
        return stack(across * cos(v), stretch * across * sin(v), r * sin(u) + lift * cos(2 * v))

    return Base(position, True, -1.0, 1.0, tube)
