"""Distances as shares of the size of the reference's bounding box."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register
from bench.geometry.used import used_vertices

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class BoxScaledDistances:
    """Chamfer and Hausdorff distances as shares of the diagonal, and of the longest edge, of the reference's box.

    ``chamfer_l1_mean_by_diagonal`` and ``hausdorff_by_diagonal`` divide the metrics of these names by the diagonal of
    the reference's axis-aligned bounding box: dsr-benchmark (Sulzer et al. 2024) prints them in per cent, the latter
    from samples only, so here, too, the vertices of meshes do not count in it.
    ``chamfer_l1_mean_by_edge`` divides by the box's longest edge, the unit of Occupancy Networks (Mescheder et al.
    2019), which prints it in tenths. ``chamfer_l2_sum_by_diagonal`` and ``hausdorff_sq_sum_by_diagonal`` are squared
    distances and divided by the square of the diagonal, for papers whose shapes share a diagonal, as those of DSS
    (Wang et al. 2019) do. Dimensionless. The box depends on the axes, so a rotation of everything changes the scores a
    little; otherwise the remarks on the two metrics hold.
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """The five scores, dimensionless."""
        pair = case.compare(output)
        edges = np.ptp(used_vertices(case.reference.mesh), axis=0)
        forward, backward = pair.to_reference.distance, pair.to_output.distance
        chamfer, farthest = (forward.mean() + backward.mean()) / 2, max(forward.max(), backward.max())
        diagonal = np.linalg.norm(edges)
        return {
            "chamfer_l1_mean_by_diagonal": float(chamfer / diagonal),
            "hausdorff_by_diagonal": float(farthest / diagonal),
            "chamfer_l1_mean_by_edge": float(chamfer / edges.max()),
            "chamfer_l2_sum_by_diagonal": float(((forward**2).mean() + (backward**2).mean()) / diagonal**2),
            "hausdorff_sq_sum_by_diagonal": float((forward.max() ** 2 + backward.max() ** 2) / diagonal**2),
        }
