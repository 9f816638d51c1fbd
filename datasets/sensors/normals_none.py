"""No normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Effect, PointCloud, Shape, register

from .spoiling import with_normals


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class NormalsNone(Effect):
    """Removes the normals."""

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """The points without normals."""
        return with_normals(cloud, None)
