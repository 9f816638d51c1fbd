"""Hausdorff distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, PointCloud, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class Hausdorff:
    """Largest nearest-neighbour distance of both directions, unsquared.

    ``max(max_p min_q |p - q|, max_q min_p |p - q|)`` over output points p and reference samples q, in frame units, as
    Points2Surf (Erler et al. 2020) reports it. MPU's tables hold the sum of both squared maxima instead. One outlier
    decides it.
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``{"hausdorff": frame units}``."""
        pair = case.compare(output)
        return {"hausdorff": float(max(pair.to_reference.distance.max(), pair.to_output.distance.max()))}
