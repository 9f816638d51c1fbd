"""Chamfer distance as the neural cages report it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register
from bench.geometry.comparison import compare
from bench.geometry.neighbours import OrderedPoints
from bench.geometry.used import used_vertices

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class RecentredChamferL2Sum:
    """Squared Chamfer distance, both directions added, each shape centred by its own bounding box.

    ``mean_p' min_q' |p' - q'|^2 + mean_q' min_p' |p' - q'|^2`` with ``p' = (p - c_output) / s``, ``q' = (q -
    c_reference) / s``, c the centres of the shapes' own boxes and s half of the longest edge of the reference's box, so
    that it has a longest side of 2; N uniform samples of each mesh. The evaluation of Neural Cages (Wang et al. 2020)
    as its script saves and samples the meshes, dimensionless. A wrong place costs nothing, and one outlier vertex
    shifts the whole output; ``chamfer_l2_sum`` is the same in the frame of the reference.
    """

    samples: int = 5000  # N, of the reference and of an output that is a mesh

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``{"recentred_chamfer_l2_sum@N": dimensionless}``."""
        name = f"recentred_chamfer_l2_sum@{self.samples}"
        pair = compare(output, case, self.samples)
        if pair.is_empty:
            return {name: float("inf")}
        own = output.points if isinstance(output, PointCloud) else used_vertices(output)
        theirs = used_vertices(case.reference.mesh)
        half_edge = np.ptp(theirs, axis=0).max() / 2
        P = OrderedPoints((pair.output_points - _box_center(own)) / half_edge)
        Q = OrderedPoints((pair.reference_points - _box_center(theirs)) / half_edge)
        forward, backward = P.nearest_in(Q).distance, Q.nearest_in(P).distance
        return {name: float((forward**2).mean() + (backward**2).mean())}


def _box_center(points: np.ndarray) -> np.ndarray:
    return (points.min(axis=0) + points.max(axis=0)) / 2
