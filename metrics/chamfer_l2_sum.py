"""Chamfer distance as MPU, DSS and the neural cages define it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, PointCloud, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, length=2, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class ChamferL2Sum:
    """Mean squared nearest-neighbour distance, both directions added.

    ``mean_p min_q |p - q|^2 + mean_q min_p |p - q|^2`` over output points p and reference samples q, in squared frame
    units. The convention of PU-Net and MPU (Wang et al. 2019), DSS (Wang et al. 2019), neural cages (Wang et al. 2020)
    and pytorch3d. Two samples of one surface of area A, with N points each, score ``2 A / (pi N)``: see the floor.
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``{"chamfer_l2_sum": squared frame units}``."""
        pair = case.compare(output)
        forward, backward = pair.to_reference.distance, pair.to_output.distance
        return {"chamfer_l2_sum": float((forward**2).mean() + (backward**2).mean())}
