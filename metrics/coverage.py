"""How much of the reference an output covers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="higher", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class Coverage:
    """Share of the reference that has an output point within reach, in units of the spacing to be expected.

    ``mean_q [min_p |p - q| <= reach sqrt(A / N)]`` over reference samples q, with A the area of the reference and N the
    number of output points (of samples, for a mesh): in 0..1. ``sqrt(A / N)`` is the side of the square that each of N
    points has to cover, so outputs of any size can reach 1. Independent uniform points cover ``1 - exp(-pi reach^2)``,
    0.957 at reach 1 (the floor); a lattice or Poisson-disk samples cover everything. A hole, a missing part and a clump
    cost their area. Robust: an outlier costs only its share of N; noise smaller than the spacing costs little, and
    points far inside a solid cover nothing.
    """

    reach: float = 1.0  # in units of sqrt(area / points)

    def __post_init__(self) -> None:
        if not self.reach > 0:
            raise ValueError(f"reach: expected a number above 0, got {self.reach}")

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``{"coverage@reach": 0..1}``."""
        pair = case.compare(output)
        distance = self.reach * np.sqrt(pair.reference_area / max(len(pair.output_points), 1))
        return {f"coverage@{self.reach:g}": float((pair.to_output.distance <= distance).mean())}
