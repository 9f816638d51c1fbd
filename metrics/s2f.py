"""Distance of the reference to an output mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, length=1, better="lower", outputs=("mesh",), floor=True, requires=("igl",))
@dataclass(frozen=True)
class S2f:
    """Exact distance of reference samples to the output mesh (surface to face): mean, root mean square, maximum.

    With ``d_q = min_(x on the output) |q - x|`` over uniform samples q of the reference surface, in frame units:
    ``s2f_mean``, ``s2f_rms = sqrt(mean d^2)`` and ``s2f_max``, the one-sided Hausdorff distance from these samples and
    the vertices of the reference mesh. The reverse of ``p2f_mean`` (Metro, Cignoni et al. 1998, takes the larger of
    both): it measures what the output lacks. It has no sampling error beyond the choice of q, but it rewards surplus
    surface: a mesh that fills space is near everything.
    """

    def score(self, output: Trimesh, case: Case) -> dict[str, float]:
        """``s2f_mean``, ``s2f_rms`` and ``s2f_max``: frame units."""
        pair = case.compare(output)
        distance = pair.from_surface.distance
        rms = float(np.sqrt((distance**2).mean()))
        return {"s2f_mean": float(distance.mean()), "s2f_rms": rms, "s2f_max": pair.from_surface_max}
