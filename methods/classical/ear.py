"""Edge-aware resampling, by CGAL."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import BadInput, PointCloud, Run, register

from .bilateral import check_angle, smooth
from .inputs import distinct_oriented
from .isolated import without_isolated
from .noise import noise_to_spacing

CELLS = 3e7  # of CGAL's grid: each costs more than half a microsecond, even with few points

NOISY, VERY_NOISY = 0.05, 0.3  # ratios of noise to spacing above which one and two passes of smoothing help


@register("method", cite="Huang et al. 2013", requires=("CGAL", "scipy"))
@dataclass(frozen=True)
class Ear:
    """Edge-aware resampling: bilateral smoothing, then points are inserted into the largest gaps and towards edges.

    Each new point is moved bilaterally onto the tangent planes of its neighbours, so creases between them stay sharp.
    That depends on the normals: exact ones halve the error on sharp shapes.
    """

    sharpness_angle: float = 35.0  # degrees by which normals may differ on one side of an edge
    edge_sensitivity: float = 0.0  # 0 spreads points evenly, 1 gathers them at edges: in clusters, and far slower
    radius: float = 2.5  # support in mean spacings; below 2 leaves gaps, above 3 flattens detail
    passes: int | None = None  # of bilateral smoothing before; None: by the noise, 0 for clean points to 2
    k: int = 24  # neighbours of the smoothing
    smooth_angle: float = 15.0  # degrees by which normals may differ in the smoothing before their weight falls

    def __post_init__(self) -> None:
        check_angle("sharpness_angle", self.sharpness_angle)
        check_angle("smooth_angle", self.smooth_angle)
        if not 0 <= self.edge_sensitivity <= 1:
            raise ValueError(f"edge_sensitivity: expected 0 to 1, got {self.edge_sensitivity}")
        if not self.radius > 0:
            raise ValueError(f"radius: expected a number above 0, got {self.radius}")
        if self.passes is not None and self.passes < 0:
            raise ValueError(f"passes: expected at least 0, got {self.passes}")
        if self.k < 3:
            raise ValueError(f"k: expected at least 3, got {self.k}")

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """Exactly ``ratio`` times as many points, with normals; the smoothed ones of the input are among them."""
        from CGAL.CGAL_Point_set_processing_3 import edge_aware_upsample_point_set

        from bench.geometry.spacing import mean_spacing

        from .point_sets import to_array, to_normals, to_point_set

        count = ratio * len(cloud)
        cloud, _ = without_isolated(cloud, "ear", run)
        points, normals, _ = distinct_oriented(cloud, "ear", at_least=10)
        passes = passes_for(points, normals) if self.passes is None else self.passes
        points, normals = smooth(points, normals, self.k, passes, self.smooth_angle, run)
        if count > len(points):
            # CGAL's default radius leaves the points worse than the input.
            radius = self.radius * mean_spacing(points)
            # CGAL sorts the points into a grid over their bounding box, whose cells have the size of the radius.
            cells = np.prod(np.ptp(points, axis=0) / radius + 1)
            if cells > CELLS:
                raise BadInput(
                    f"ear: the bounding box has {cells:.1g} cells of the size of the radius; expected at most "
                    f"{CELLS:.1g} (remove far outliers, process distant parts one by one, or raise radius)"
                )
            point_set = to_point_set(points, normals)
            edge_aware_upsample_point_set(point_set, self.sharpness_angle, self.edge_sensitivity, radius, count)
            points, normals = to_array(point_set), to_normals(point_set)
        good = np.flatnonzero(np.isfinite(points).all(axis=1) & np.isfinite(normals).all(axis=1))
        chosen = np.resize(good, count)  # repeated points replace those that could not be inserted
        lengths = np.linalg.norm(normals[chosen], axis=1, keepdims=True)
        return PointCloud(points[chosen], normals[chosen] / lengths)


def passes_for(points: np.ndarray, normals: np.ndarray) -> int:
    """The passes of smoothing that were best on the train shapes at the noise of these points, see docs/tuning.md."""
    noise = noise_to_spacing(points, normals)
    return int(noise >= NOISY) + int(noise >= VERY_NOISY)
