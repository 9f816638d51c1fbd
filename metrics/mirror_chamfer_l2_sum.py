"""How far an output is from its own mirror image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register
from bench.geometry.comparison import compare
from bench.geometry.neighbours import OrderedPoints

if TYPE_CHECKING:
    from trimesh import Trimesh

PLANE = "mirror x"


@register("metric", version=1, length=2, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class MirrorChamferL2Sum:
    """Squared Chamfer distance between an output and its reflection in the plane of symmetry, both directions added.

    ``2 mean_p min_q |p - Mq|^2`` over N uniform samples p and q of the output, ``M = diag(-1, 1, 1)``: the plane is x =
    0 of the frame, in which a reference whose dataset says ``symmetry: mirror x`` is symmetric. In squared frame
    units; the floor is the reference's own. The symmetry loss of 3DN and Neural Cages (Wang et al. 2019, 2020) as a
    score: a deformation of a symmetric shape to a symmetric shape should stay symmetric. It says nothing about the
    distance to the reference. Scores ``{}`` where the reference has no such plane.
    """

    samples: int = 20_000  # N

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``mirror_chamfer_l2_sum``; ``{}`` where it does not apply."""
        if PLANE not in str(case.reference.info.get("symmetry", "")):
            return {}
        pair = compare(output, case, self.samples)
        if pair.is_empty:
            return {"mirror_chamfer_l2_sum": float("inf")}
        points, mirrored = OrderedPoints(pair.output_points), OrderedPoints(pair.output_points * (-1, 1, 1))
        # A reflection is its own inverse: the other direction is the same number.
        distance = points.nearest_in(mirrored).distance
        return {"mirror_chamfer_l2_sum": float(2 * np.square(distance).mean())}
