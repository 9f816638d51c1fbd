"""Normal distances as IDF and iso-points define them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register

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

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """Both forms, in 0..2, or ``{}`` for a cloud without normals."""
        pair = case.compare(output)
        if pair.is_empty:
            return dict.fromkeys(("normal_cosine_distance_oriented_mean", "normal_cosine_distance_sum"), 2.0)
        cosines = nearest_cosines(pair)
        if cosines is None:
            return {}
        return {
            "normal_cosine_distance_oriented_mean": float(sum((1 - c).mean() for c in cosines) / 2),
            "normal_cosine_distance_sum": float(sum((1 - np.abs(c)).mean() for c in cosines)),
        }
