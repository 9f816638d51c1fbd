"""Chamfer distance as Points2Surf defines it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, generator, register
from bench.geometry.comparison import compare
from bench.geometry.neighbours import OrderedPoints
from bench.geometry.used import used_vertices

if TYPE_CHECKING:
    from trimesh import Trimesh


@register(
    "metric",
    version=1,
    length={"chamfer_l1_point_sum": 1},
    better="lower",
    outputs=("mesh", "cloud"),
    floor=True,
    requires=("pykdtree", "scipy"),
)
@dataclass(frozen=True)
class ChamferL1PointSum:
    """Unsquared nearest-neighbour distances of both directions, summed as Points2Surf does.

    With N samples a side: ``chamfer_l1_point_sum@N = sum_p min_q |p - q| + sum_q min_p |p - q|``, uniform samples, in
    frame units; it grows with N. ``chamfer_l1_sum_by_edge@N = (mean_p min_q |p - q| + mean_q min_p |p - q|) / e``, with
    e the longest edge of the reference's box, is dimensionless: the distance in the frame where the box fits the unit
    cube. ``rejection_chamfer_l1_sum_by_edge@N`` is the same with the samples of Points2Surf (Erler et al. 2020): of 3 N
    uniform ones on a surface of area A, one point of each pair closer than ``sqrt(A / (3 N))`` is removed, and N of the
    rest are used. They are spaced more evenly, and the floor is about 15 % lower. The paper prints this mean, times
    100; its script sums over the points, in the coordinates of the files, which lie in the unit cube in its data set.

    A cloud is used as it is. The first two, divided by 2 N and by 2, are ``chamfer_l1_mean`` with N samples, in frame
    units and in edges; the remarks there hold here.
    """

    samples: int = 10_000  # N, of the reference and of an output that is a mesh

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """The three scores, each with ``@N`` after its name: frame units, and dimensionless."""
        pair = compare(output, case, self.samples)
        forward, backward = pair.to_reference.distance, pair.to_output.distance
        edge = float(np.ptp(used_vertices(case.reference.mesh), axis=0).max())
        even = float("inf") if pair.is_empty else self._of_rejection_samples(output, case)
        scores = {
            "chamfer_l1_point_sum": forward.sum() + backward.sum(),
            "chamfer_l1_sum_by_edge": (forward.mean() + backward.mean()) / edge,
            "rejection_chamfer_l1_sum_by_edge": even / edge,
        }
        return {f"{name}@{self.samples}": float(value) for name, value in scores.items()}

    def _of_rejection_samples(self, output: PointCloud | Trimesh, case: Case) -> float:
        """Both means, added, in frame units."""
        truth = case.remember(
            f"reference {self.samples} by rejection",
            lambda: {"points": self._sample(case.reference.mesh, case, "reference")},
        )["points"]
        points = output.points if isinstance(output, PointCloud) else self._sample(output, case, "output")
        P, Q = OrderedPoints(points), OrderedPoints(truth)
        return P.nearest_in(Q).distance.mean() + Q.nearest_in(P).distance.mean()

    def _sample(self, mesh: Trimesh, case: Case, stream: str) -> np.ndarray:
        """(N, 3) samples by rejection, sometimes fewer, as trimesh gives them; for a cloud its own points."""
        from trimesh.sample import sample_surface_even

        if not len(mesh.faces):
            return np.asarray(mesh.vertices)
        seed = int(generator(case.seed, case.id, stream, "rejection").integers(2**31))
        return np.asarray(sample_surface_even(mesh, self.samples, seed=seed)[0])
