"""The usual distances with a number of samples that a paper fixes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register
from bench.geometry.comparison import compare

from .normal_cosine import nearest_cosines

if TYPE_CHECKING:
    from trimesh import Trimesh


@register(
    "metric",
    version=1,
    length={"chamfer_l1_mean": 1, "chamfer_l2_sum": 2, "hausdorff": 1},
    better="lower",
    outputs=("mesh", "cloud"),
    floor=True,
    requires=("pykdtree",),
)
@dataclass(frozen=True)
class SampledDistances:
    """Chamfer, Hausdorff and normal distances from N samples of each surface, for tables that fix N.

    ``chamfer_l1_mean@N``, ``chamfer_l2_sum@N``, ``hausdorff@N`` and ``normal_cosine_distance_sum@N`` are the metrics of
    these names (there with the usual 100,000 samples) over N uniform samples of the reference, and of an output that is
    a mesh; a cloud is used as it is. Vertices do not count in ``hausdorff@N``. The floors fall with N: like ``1 /
    sqrt(N)`` for l1, ``1 / N`` for l2. The default is the number in iso-points (Wang et al. 2021).
    """

    samples: int = 50_000  # N, of the reference and of an output that is a mesh

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """The four scores, each with ``@N`` after its name; no normal distance for a cloud without normals."""
        pair = compare(output, case, self.samples)
        forward, backward = pair.to_reference.distance, pair.to_output.distance
        scores = {
            "chamfer_l1_mean": (forward.mean() + backward.mean()) / 2,
            "chamfer_l2_sum": (forward**2).mean() + (backward**2).mean(),
            "hausdorff": max(forward.max(), backward.max()),
        }
        cosines = None if pair.is_empty else nearest_cosines(pair)
        if pair.is_empty:
            scores["normal_cosine_distance_sum"] = 2.0
        elif cosines is not None:
            scores["normal_cosine_distance_sum"] = sum((1 - np.abs(c)).mean() for c in cosines)
        return {f"{name}@{self.samples}": float(value) for name, value in scores.items()}
