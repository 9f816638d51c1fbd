"""Chamfer distance as the reconstruction benchmarks define it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, PointCloud, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, length=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class ChamferL1Mean:
    """Mean unsquared nearest-neighbour distance, average of both directions.

    ``(mean_p min_q |p - q| + mean_q min_p |p - q|) / 2`` over output points p and reference samples q, in frame units.
    The "Chamfer-L1" of Occupancy Networks (Mescheder et al. 2019) and of later papers; the distances are
    Euclidean, the L1 is in the sum. Two samples of one surface of area A, with N points each, score
    ``0.5 sqrt(A / N)``: see the floor.
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``{"chamfer_l1_mean": frame units}``."""
        pair = case.compare(output)
        return {"chamfer_l1_mean": float((pair.to_reference.distance.mean() + pair.to_output.distance.mean()) / 2)}
