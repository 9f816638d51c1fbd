"""Chamfer distance as implicit displacement fields define it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, PointCloud, register
from bench.geometry.comparison import compare

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, length=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class ChamferL1Sum:
    """Mean unsquared nearest-neighbour distance, both directions added.

    ``mean_p min_q |p - q| + mean_q min_p |p - q|`` over output points p and reference samples q, in frame units: twice
    ``chamfer_l1_mean``. The "Chamfer distance" of IDF (Wang et al. 2022) and of point-cloud-utils. Robust: one outlier
    among N changes it by its distance / N. It rewards even spacing: two samples of one surface of area A, with N points
    each, score ``sqrt(A / N)``, see the floor; this is most of the scores in IDF's tables, despite millions of points.
    """

    samples: int = 0  # N of each surface, then part of the score's name (IDF: 5,000,000); 0 for the usual number

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``{"chamfer_l1_sum": frame units}``, or ``chamfer_l1_sum@N``."""
        pair = compare(output, case, self.samples)
        name = f"chamfer_l1_sum@{self.samples}" if self.samples else "chamfer_l1_sum"
        return {name: float(pair.to_reference.distance.mean() + pair.to_output.distance.mean())}
