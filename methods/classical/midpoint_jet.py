"""Upsampling by midpoints on local quadrics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Run, register
from bench.geometry.farthest import load_compiled

from .inputs import distinct_points


@register("method", cite="quadrics: Cazals and Pouget 2005; thinning: Eldar et al. 1997", requires=("scipy", "numba"))
@dataclass(frozen=True)
class MidpointJet:
    """Midpoints between neighbours, moved onto local quadrics and thinned by farthest points: cheap and even."""

    k: int = 12  # neighbours of a fit; more remove noise, and detail with it
    keep: bool = True  # whether the points of the input stay in place instead of moving onto the surface

    def __post_init__(self) -> None:
        if self.k < 6:
            raise ValueError(f"k: a quadric needs at least 6 neighbours, got {self.k}")

    prepare = staticmethod(load_compiled)

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """Exactly ``ratio`` times as many points; the distinct points of the input come first, in its order."""
        from scipy.spatial import cKDTree

        from .quadrics import project_to_quadrics
        from .refinement import refine

        points, inverse = distinct_points(cloud.points, "midpoint_jet", at_least=4)
        tree = cKDTree(points)

        def project(queries: np.ndarray) -> np.ndarray:
            return project_to_quadrics(queries, tree, self.k)

        return PointCloud(refine(points if self.keep else project(points), ratio * len(cloud), project))
