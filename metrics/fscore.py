"""Precision, recall and F-score at a distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, PointCloud, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="higher", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class Fscore:
    """Harmonic mean of precision and recall at a distance threshold.

    ``F = 2 P R / (P + R)``, and 0 when P = R = 0. P is the share of output points whose nearest reference sample is no
    farther than t, R the share of reference samples whose nearest output point is no farther than t: Knapitsch et al.
    2017 (Tanks and Temples). The threshold is a plain distance, not a squared one. Note the floor: where t is not
    much larger than the spacing of the samples, a perfect output scores below 1.
    """

    t: float = 0.01  # threshold in frame units: a share of the reference's radius

    def __post_init__(self) -> None:
        if not self.t > 0:
            raise ValueError(f"t: expected a distance above 0, got {self.t}")

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``fscore@t``, ``precision@t`` and ``recall@t``, each in 0..1."""
        pair = case.compare(output)
        precision = float((pair.to_reference.distance <= self.t).mean())
        recall = float((pair.to_output.distance <= self.t).mean())
        both = precision + recall
        return {
            f"fscore@{self.t:g}": 2 * precision * recall / both if both else 0.0,
            f"precision@{self.t:g}": precision,
            f"recall@{self.t:g}": recall,
        }
