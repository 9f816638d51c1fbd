"""Normal distances as IDF and iso-points define them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register
from bench.geometry.comparison import compare

from .normal_cosine import nearest_cosines

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class NormalCosineDistance:
    """One minus the cosine between the normals of nearest points, in the two forms of the papers.

    With q(p) the reference sample nearest to the output point p, and p(q) the other way:
    ``normal_cosine_distance_oriented_mean = (mean_p (1 - n_p . n_q(p)) + mean_q (1 - n_q . n_p(q))) / 2`` is IDF's
    (Wang et al. 2022, whose code adds (1 - cos) / 2 over both directions), in 0..2: flipped normals score 2.
    ``normal_cosine_distance_sum = mean_p (1 - |n_p . n_q(p)|) + mean_q (1 - |n_q . n_p(q)|)`` is pytorch3d's, which
    iso-points (Wang et al. 2021) prints, in 0..2: random normals score 1. Dimensionless. The remarks on
    ``normal_cosine`` hold here too.
    """

    samples: int = 0  # N of each surface, then part of the scores' names (IDF: 5,000,000); 0 for the usual number

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """Both forms, in 0..2, or ``{}`` for a cloud without normals; with N samples their names end in ``@N``."""
        pair = compare(output, case, self.samples)
        at = f"@{self.samples}" if self.samples else ""
        oriented, unoriented = (f"normal_cosine_distance_{form}{at}" for form in ("oriented_mean", "sum"))
        if pair.is_empty:
            return {oriented: 2.0, unoriented: 2.0}
        cosines = nearest_cosines(pair)
        if cosines is None:
            return {}
        return {
            oriented: float(sum((1 - c).mean() for c in cosines) / 2),
            unoriented: float(sum((1 - np.abs(c)).mean() for c in cosines)),
        }
