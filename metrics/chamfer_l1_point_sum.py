"""Chamfer distance as Points2Surf defines it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, PointCloud, register
from bench.geometry.comparison import compare

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class ChamferL1PointSum:
    """Sum over all points of the unsquared nearest-neighbour distances of both directions.

    ``sum_p min_q |p - q| + sum_q min_p |p - q|`` over N uniform samples of each mesh, in frame units: the "Chamfer
    distance" of Points2Surf (Erler et al. 2020). It grows with the number of samples, which is therefore in the name.
    The original draws each sample by rejection and may get fewer than it asked for; here it is N exactly. A cloud is
    taken as it is. Divided by 2 N it is ``chamfer_l1_mean`` with N samples; what is said there holds here.
    """

    samples: int = 10_000  # N, of the reference and of an output that is a mesh

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``{"chamfer_l1_point_sum@N": frame units}``."""
        pair = compare(output, case, self.samples)
        total = pair.to_reference.distance.sum() + pair.to_output.distance.sum()
        return {f"chamfer_l1_point_sum@{self.samples}": float(total)}
