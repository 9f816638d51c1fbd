"""Radius outlier removal, by Open3D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Run, register

from .inputs import distinct_points
from .statistical_outlier import refuse_none


@register("method", cite="Rusu and Cousins 2011", requires=("open3d", "scipy"))
@dataclass(frozen=True)
class RadiusOutlier:
    """Radius outlier removal: points with too few others around them go, and clusters of up to ``least`` points."""

    radius: float = 3.0  # in mean spacings
    least: int = 2  # least number of other points within the radius; a random sample of a plane has about 7 within 3

    def __post_init__(self) -> None:
        if not self.radius > 0:
            raise ValueError(f"radius: expected a number above 0, got {self.radius}")
        if self.least < 1:
            raise ValueError(f"least: expected at least 1, got {self.least}")

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """The points of the input that remain, unmoved and in its order, with their own normals."""
        import open3d as o3d

        from bench.geometry.spacing import mean_spacing

        points, inverse = distinct_points(cloud.points, "radius_outlier", at_least=2)
        distinct = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        # Open3D counts a point among its own neighbours, and keeps points with more than the given number.
        _, inliers = distinct.remove_radius_outlier(self.least, self.radius * mean_spacing(points))
        kept = np.isin(inverse, np.asarray(inliers))
        refuse_none(kept, "radius_outlier", "raise radius, or lower least")
        return cloud.subset(kept)
