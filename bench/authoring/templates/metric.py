"""MyPlugin: say in a line what is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register

if TYPE_CHECKING:
    from trimesh import Trimesh


# Raise the version whenever the numbers change: results of the old version are then recomputed.
@register("metric", version=1, better="lower", outputs=("mesh", "cloud"))
@dataclass(frozen=True)
class MyPlugin:
    """Median distance of the output to the reference's surface (replace this by your formula)."""

    def score(self, output: Trimesh | PointCloud, case: Case) -> dict[str, float]:
        """Score -> value; leave a score out where it is not defined for this output."""
        # case.compare(output) holds the directed distances, computed once and shared by all metrics.
        return {"my_plugin": float(np.median(case.compare(output).to_surface.distance))}
