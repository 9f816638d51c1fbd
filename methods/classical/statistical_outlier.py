"""Statistical outlier removal, by Open3D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import BadInput, PointCloud, Run, register

from .inputs import distinct_points


@register("method", cite="Rusu et al. 2008", requires=("open3d",))
@dataclass(frozen=True)
class StatisticalOutlier:
    """Statistical outlier removal: points that are farther from their neighbours than most are left out."""

    k: int = 8  # neighbours whose mean distance is tested
    threshold: float = 3.0  # standard deviations above the mean distance beyond which a point is an outlier
    passes: int = 1  # far outliers hide near ones, which a second pass finds

    def __post_init__(self) -> None:
        if self.k < 1:
            raise ValueError(f"k: expected at least 1, got {self.k}")
        if not self.threshold > 0:
            raise ValueError(f"threshold: expected a number above 0, got {self.threshold}")
        if self.passes < 1:
            raise ValueError(f"passes: expected at least 1, got {self.passes}")

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """The points of the input that remain, unmoved and in its order, with their own normals."""
        import open3d as o3d

        points, inverse = distinct_points(cloud.points, "statistical_outlier", at_least=2)
        kept = np.arange(len(points))
        for _ in range(self.passes):
            remaining = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points[kept]))
            # Open3D counts a point among its own neighbours.
            _, inliers = remaining.remove_statistical_outlier(min(self.k + 1, len(kept)), self.threshold)
            if len(inliers):
                kept = kept[np.asarray(inliers)]
        return cloud.subset(np.isin(inverse, kept))


def refuse_none(kept: np.ndarray, method: str, advice: str) -> None:
    """Raise BadInput when no point is ``kept``."""
    if not kept.any():
        raise BadInput(f"{method}: none of {len(kept)} points is kept; expected points of a surface ({advice})")
