"""Star-shaped bodies with bumps of a controlled spectrum, known exactly."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, spread
from .surfaces.harmonics import HarmonicSum
from .surfaces.star_surface import StarSurface, icosphere

SMALLEST_RADIUS = 0.25  # below it a body is nearly cut in two, and its tessellation uneven


@register("dataset", requires=("scipy", "trimesh"))
@dataclass(frozen=True)
class Bumps(Family):
    """Smooth star-shaped bodies from spherical harmonics; exact samples, normals and closest points.

    The surface is ``x = r(u) u`` with ``r(u) = 1 + sum over l = 2..degree, m of a_lm Y_lm(u)``. The ``a_lm`` are normal
    with the variance ``l^-exponent``, then scaled so that the root mean square of r - 1 is ``amplitude``.
    Degree 1, which shifts the body, is left out. The exponents of the shapes are spread evenly between the two
    limits (a golden-ratio sequence), so that there are both smooth and rough shapes among the first few.
    A draw whose r falls below 0.25 is repeated.
    """

    degree: int = 16  # highest degree of the spherical harmonics: the finest bumps are about pi / degree wide
    exponent_low: float = 1.5  # variance of a coefficient ~ degree^-exponent: exponent of the roughest shapes
    exponent_high: float = 4.5  # and of the smoothest; equal limits give one spectrum
    amplitude: float = 0.12  # root mean square of r - 1
    subdivisions: int = 6  # of the icosphere that tessellates: 6 gives 40,962 vertices and 81,920 faces

    def __post_init__(self) -> None:
        if not 2 <= self.degree <= 64:
            raise ValueError(f"degree: expected 2 to 64, got {self.degree}")
        if not self.exponent_low <= self.exponent_high:
            raise ValueError(
                f"exponent_low: expected at most exponent_high={self.exponent_high}, got {self.exponent_low}"
            )
        if not 0 <= self.amplitude <= 0.3:
            raise ValueError(f"amplitude: expected 0 to 0.3, got {self.amplitude}")
        if not 0 <= self.subdivisions <= 9:
            raise ValueError(f"subdivisions: expected 0 to 9, got {self.subdivisions}")

    def _shape(self, split: str, index: int) -> Shape:
        exponent = self._exponent(index)
        surface = StarSurface(lambda: self._radius(split, index, exponent))
        return Shape(
            f"bumps-{split}-{index:03d}",
            lambda: surface.mesh(self.subdivisions),
            surface=surface,
            exactness="parametric",
            info={
                "genus": 0,
                "symmetry": "none",
                "degree": self.degree,
                "exponent": exponent,
                "amplitude": self.amplitude,
            },
        )

    def _exponent(self, index: int) -> float:
        return self.exponent_low + (self.exponent_high - self.exponent_low) * spread(index)

    def _radius(self, split: str, index: int, exponent: float) -> HarmonicSum:
        rng = generator("bumps", split, index)
        degrees = np.repeat(np.arange(self.degree + 1), 2 * np.arange(self.degree + 1) + 1)
        deviations = np.where(degrees >= 2, np.maximum(degrees, 1.0) ** (-exponent / 2), 0.0)
        for _ in range(200):
            coefficients = deviations * rng.normal(size=len(degrees))
            # The basis is orthonormal: the mean square over the sphere is the sum of squares divided by 4 pi.
            coefficients *= self.amplitude * sqrt(4 * pi / (coefficients**2).sum())
            coefficients[0] = sqrt(4 * pi)
            radius = HarmonicSum(coefficients)
            if radius.value(icosphere(5)[0]).min() >= SMALLEST_RADIUS:
                return radius
        raise ValueError(f"amplitude: at {self.amplitude} no shape keeps r above {SMALLEST_RADIUS}; try a smaller one")
