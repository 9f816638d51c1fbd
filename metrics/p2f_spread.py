"""The distribution of the point-to-face distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, length=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("igl",))
@dataclass(frozen=True)
class P2fSpread:
    """Root mean square, standard deviation and maximum of the exact distance to the reference mesh.

    With ``d_p = min_(x on the mesh) |p - x|`` over the points of a cloud, or over uniform samples of a mesh, in frame
    units: ``p2f_rms = sqrt(mean d^2)``, ``p2f_std = sqrt(mean (d - mean d)^2)``, ``p2f_max = max d``, where the
    vertices of an output mesh count beside its samples, since a spike without an area gets no samples. MPU's tool
    prints mean and std pooled over the points of all shapes; here they are per case. All are one-sided, like
    ``p2f_mean``; one outlier decides the maximum, a few decide the other two. A low ``p2f_std`` alone means nothing: it
    is 0 for an output that is off by the same amount everywhere.
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``p2f_rms``, ``p2f_std`` and ``p2f_max``: frame units."""
        pair = case.compare(output)
        if pair.is_empty:
            return dict.fromkeys(("p2f_rms", "p2f_std", "p2f_max"), float("inf"))
        distance = pair.to_surface.distance
        rms = float(np.sqrt((distance**2).mean()))
        return {"p2f_rms": rms, "p2f_std": float(distance.std()), "p2f_max": pair.to_surface_max}
