"""Hausdorff distance as the tables of MPU report it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, PointCloud, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, length=2, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class HausdorffSqSum:
    """Largest squared nearest-neighbour distance, both directions added.

    ``max_p min_q |p - q|^2 + max_q min_p |p - q|^2`` over output points p and reference samples q, in squared frame
    units. What PU-Net, MPU (Wang et al. 2019), DSS (Wang et al. 2019) and PU-GAN print as "Hausdorff distance"; the
    Hausdorff distance itself is :mod:`hausdorff`. As in these papers, only samples count: they miss a spike without an
    area. One outlier decides it, by its square.
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``{"hausdorff_sq_sum": squared frame units}``."""
        pair = case.compare(output)
        return {"hausdorff_sq_sum": float(pair.to_reference.distance.max() ** 2 + pair.to_output.distance.max() ** 2)}
