"""Normals on the wrong side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import BadInput, Effect, PointCloud, Shape, register

from .checks import expect
from .spoiling import some_of, with_normals


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class NormalsFlip(Effect):
    """A share of the normals, anywhere, points to the wrong side."""

    fraction: float = 0.1  # of the normals that are flipped; 1 turns all of them inward

    def __post_init__(self) -> None:
        expect(0 <= self.fraction <= 1, "fraction", "0 to 1", self.fraction)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """The same points, with some normals flipped."""
        if cloud.normals is None:
            raise BadInput("sensor normals_flip: the cloud has no normals; put a step that adds normals before it")
        normals = cloud.normals.copy()
        normals[some_of(cloud, self.fraction, rng)] *= -1
        return with_normals(cloud, normals)
