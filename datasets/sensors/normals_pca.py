"""Estimated normals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import Effect, PointCloud, Shape, register
from bench.geometry.normals import estimate_normals, oriented_normals

from .checks import expect, expect_choice
from .spoiling import with_normals


@register("sensor", requires=("open3d",), cite="Hoppe et al. 1992; orientation: König and Gumhold 2009")
@dataclass(frozen=True)
class NormalsPca(Effect):
    """Normals estimated from the given points: planes through the neighbours, oriented along a spanning tree.

    The number of neighbours is chosen for each point, from 12 to 256, by the noise and the shape, or is ``k`` for all.
    With ``orientation=exact`` the signs are those of the exact surface, as in data sets for denoising; then only the
    directions have errors.
    """

    orientation: Literal["tree", "exact"] = "tree"  # signs from the points alone, or from the exact surface
    k: int = 0  # neighbours of a plane, the point itself included, at least 3; 0 chooses for each point

    def __post_init__(self) -> None:
        expect(self.k == 0 or self.k >= 3, "k", "0, or at least 3", self.k)
        expect_choice("orientation", self.orientation, ("tree", "exact"))

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """The same points, with estimated normals."""
        if self.orientation == "tree":
            return with_normals(cloud, oriented_normals(cloud.points, self.k))
        normals = estimate_normals(cloud.points, self.k).normals
        inward = np.einsum("ni,ni->n", normals, shape.surface.closest(cloud.points)[1]) < 0
        return with_normals(cloud, np.where(inward[:, None], -normals, normals))
