"""Distances after each shape is normalised on its own, as the upsampling papers do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register
from bench.geometry.comparison import compare
from bench.geometry.neighbours import OrderedPoints
from bench.geometry.reference_sample import POISSON_DISK, UNIFORM, evenly_perfect

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=2, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree", "open3d"))
@dataclass(frozen=True)
class OwnSphereDistances:
    """Squared Chamfer and Hausdorff distances, both shapes normalised by their own centroid and farthest point.

    ``P' = (P - mean P) / max |p - mean P|``, ``Q'`` likewise from the reference samples, then
    ``own_sphere_chamfer_l2_sum = mean_p' min_q' |p' - q'|^2 + mean_q' min_p' |p' - q'|^2`` and
    ``own_sphere_hausdorff_sq_sum = max_p' min_q' |p' - q'|^2 + max_q' min_p' |p' - q'|^2``; dimensionless. The
    evaluation script of MPU (Wang et al. 2019) and PU-GAN (Li et al. 2019), whose ground truth is a Poisson-disk cloud
    as large as the output: so are the reference samples, at most 200,000. A mesh and its reference get uniform samples.
    A reference that is a cloud is used as it is.

    Fragile, and meant for comparison with papers only: the output determines its own frame. One outlier shrinks the
    whole output, and a wrong size or place costs nothing. ``even_distances`` are the same in the reference's frame.
    """

    samples: int = 0  # of the reference; 0: as many as the output has points

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``own_sphere_chamfer_l2_sum`` and ``own_sphere_hausdorff_sq_sum``, dimensionless."""
        if case.compare(output).is_empty:
            return dict.fromkeys(("own_sphere_chamfer_l2_sum", "own_sphere_hausdorff_sq_sum"), float("inf"))
        is_cloud = isinstance(output, PointCloud)
        samples = self.samples or (len(output) if isinstance(output, PointCloud) else 0)
        pair = compare(output, case, samples, POISSON_DISK if is_cloud else UNIFORM)
        P, Q = (OrderedPoints(in_own_sphere(points)) for points in (pair.output_points, pair.reference_points))
        forward, backward = P.nearest_in(Q).distance ** 2, Q.nearest_in(P).distance ** 2
        return {
            "own_sphere_chamfer_l2_sum": float(forward.mean() + backward.mean()),
            "own_sphere_hausdorff_sq_sum": float(forward.max() + backward.max()),
        }

    def perfect(self, output: PointCloud | Trimesh, case: Case) -> PointCloud | Trimesh:
        """Another Poisson-disk sample, as large as the output; for a mesh the reference mesh."""
        return evenly_perfect(output, case)


def in_own_sphere(points: np.ndarray) -> np.ndarray:
    """(n, 3) points with their mean at the origin and the farthest at distance 1; all at the origin if all coincide."""
    centered = points - points.mean(axis=0)
    radius = np.linalg.norm(centered, axis=1).max()
    return centered / radius if radius > 0 else centered
