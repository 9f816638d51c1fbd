"""Errors of the normals' directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import BadInput, Effect, PointCloud, Shape, register

from .checks import expect
from .spoiling import with_normals


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class NormalsNoise(Effect):
    """Normals tilted at random, in any direction.

    The two tangential angles are Gaussian, so that the tilt has a Rayleigh distribution with mean 1.25 ``degrees`` and
    mean square 2 ``degrees^2``. Gaussian noise of a small deviation s in x, y and z of the unit normal is the same as
    ``degrees = s 180 / pi``.
    """

    degrees: float = 10.0  # standard deviation of the tilt about each of two axes

    def __post_init__(self) -> None:
        expect(0 <= self.degrees <= 90, "degrees", "0 to 90", self.degrees)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """The same points, with tilted normals."""
        if cloud.normals is None:
            raise BadInput("sensor normals_noise: the cloud has no normals; put a step that adds normals before it")
        normals = cloud.normals
        noise = np.radians(self.degrees) * rng.normal(size=normals.shape)
        tangent = noise - np.einsum("ni,ni->n", noise, normals)[:, None] * normals
        angle = np.linalg.norm(tangent, axis=1, keepdims=True)
        # Along a great circle: the tilt is the length of the tangent, for any length.
        return with_normals(cloud, np.cos(angle) * normals + np.sinc(angle / np.pi) * tangent)
