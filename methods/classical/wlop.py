"""Weighted locally optimal projection, by CGAL."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Run, register

from .inputs import distinct_points
from .isolated import without_isolated
from .noise import noise_of


@register("method", cite="Huang et al. 2009", requires=("CGAL", "scipy"))
@dataclass(frozen=True)
class Wlop:
    """Weighted locally optimal projection: points are drawn to local medians and pushed apart evenly."""

    retain: float = 100.0  # number of output points, in percent of the input (of its distinct points)
    radius: float | None = None  # support in mean spacings; larger smooths more; None: by the noise, 2 to 4
    iterations: int = 10  # passes; with 35 the error is the same to 2 %
    uniform: bool = False  # weigh by density, for unevenly sampled input; slower

    def __post_init__(self) -> None:
        if not 0 < self.retain <= 100:
            raise ValueError(f"retain: expected a percentage above 0 and up to 100, got {self.retain}")
        if self.radius is not None and not self.radius > 0:
            raise ValueError(f"radius: expected a number above 0, got {self.radius}")

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the input has distinct ones, or a share of them, unordered; isolated ones last, unmoved."""
        from CGAL.CGAL_Point_set_3 import Point_set_3
        from CGAL.CGAL_Point_set_processing_3 import wlop_simplify_and_regularize_point_set

        from bench.geometry.spacing import mean_spacing

        from .point_sets import to_array, to_point_set

        rest, kept = without_isolated(cloud, "wlop", run)
        points, _ = distinct_points(rest.points, "wlop", at_least=10)
        support = radius_for(rest) if self.radius is None else self.radius
        # CGAL's default radius was observed to leave the cloud worse than the input.
        radius = support * mean_spacing(points)
        output = Point_set_3()
        wlop_simplify_and_regularize_point_set(
            to_point_set(points), output, self.retain, radius, self.iterations, self.uniform
        )
        return PointCloud(np.concatenate([to_array(output), np.unique(cloud.points[~kept], axis=0)]))


def radius_for(cloud: PointCloud) -> float:
    """The support that was best on the train shapes at the noise of this cloud, see docs/tuning.md."""
    return float(np.clip(2 + 6 * noise_of(cloud, "wlop", at_least=10), 2, 4))
