"""The two directed distances of a case, each by itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register

if TYPE_CHECKING:
    from trimesh import Trimesh

PERCENTILES = (50, 90, 95, 99)


@register(
    "metric", version=1, length=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree", "igl")
)
@dataclass(frozen=True)
class Directed:
    """Mean, percentiles and maximum of each directed nearest-neighbour distance, unsquared.

    ``to_reference_*``: of each output point p, ``min_q |p - q|`` (accuracy: surplus parts of the output);
    ``to_output_*``: of each reference sample q, ``min_p |p - q|`` (completeness: missing parts). In frame units;
    percentiles are interpolated linearly. In the maxima the vertices of meshes count too, as in ``hausdorff``. Berger
    et al. 2013 report such distributions for both directions. A median ignores the worst half of an output, a maximum
    is decided by one point; one direction alone can be perfect: the first for a single right point, the second for an
    output that fills space.
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``to_reference_*`` and ``to_output_*`` with mean, p50, p90, p95, p99 and max in place of the star."""
        pair = case.compare(output)
        directions = {
            "to_reference": (pair.to_reference.distance, pair.to_reference_max),
            "to_output": (pair.to_output.distance, pair.to_output_max),
        }
        return {f"{name}_{key}": value for name, d in directions.items() for key, value in _statistics(*d).items()}


def _statistics(distances: np.ndarray, largest: float) -> dict[str, float]:
    if not np.isfinite(distances).all():  # an empty output; interpolating between infinities would give NaN
        return dict.fromkeys(["mean", *(f"p{p}" for p in PERCENTILES), "max"], float("inf"))
    percentiles = np.percentile(distances, PERCENTILES)
    values = {"mean": distances.mean(), **{f"p{p}": v for p, v in zip(PERCENTILES, percentiles, strict=True)}}
    return {name: float(value) for name, value in values.items()} | {"max": largest}
