"""Jet smoothing, by CGAL."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Run, register

from .inputs import distinct_points
from .isolated import put_back, without_isolated
from .noise import noise_of


@register("method", cite="Cazals and Pouget 2005", requires=("CGAL", "scipy"))
@dataclass(frozen=True)
class Jet:
    """Jet smoothing: every point moves onto a quadric fitted to its nearest neighbours."""

    k: int | None = None  # neighbours of the fit; more smooth more; None: by the noise, 12 to 30
    iterations: int = 1  # passes; more smooth more

    def __post_init__(self) -> None:
        if self.k is not None and self.k < 6:
            raise ValueError(f"k: a quadric needs at least 6 neighbours, got {self.k}")

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the input has, in its order."""
        from CGAL.CGAL_Point_set_processing_3 import jet_smooth_point_set

        from .point_sets import to_array, to_point_set

        rest, kept = without_isolated(cloud, "jet", run)
        points, inverse = distinct_points(rest.points, "jet", at_least=10)
        k = neighbours_for(rest) if self.k is None else self.k
        point_set = to_point_set(points)
        for done in range(self.iterations):
            jet_smooth_point_set(point_set, min(k, len(points) - 1))
            run.progress(done + 1, self.iterations)
        return put_back(cloud, kept, to_array(point_set)[inverse])


def neighbours_for(cloud: PointCloud) -> int:
    """The number of neighbours that was best on the train shapes at the noise of this cloud, see docs/tuning.md."""
    return int(np.clip(12 + 30 * noise_of(cloud, "jet", at_least=10), 12, 30))
