"""Distances to an evenly spread ground truth as large as the output, in the frame of the reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, PointCloud, register
from bench.geometry.comparison import compare
from bench.geometry.reference_sample import POISSON_DISK, evenly_perfect

if TYPE_CHECKING:
    from trimesh import Trimesh


@register(
    "metric", version=1, length=2, better="lower", outputs=("cloud",), floor=True, requires=("pykdtree", "open3d")
)
@dataclass(frozen=True)
class EvenDistances:
    """Squared Chamfer and Hausdorff distances to Poisson-disk samples of the reference, as many as the output has.

    ``even_chamfer_l2_sum = mean_p min_q |p - q|^2 + mean_q min_p |p - q|^2`` and ``even_hausdorff_sq_sum = max_p min_q
    |p - q|^2 + max_q min_p |p - q|^2`` over the N output points p and N Poisson-disk samples q of the reference
    (Yuksel 2015), in squared frame units. The ground truth of the papers on upsampling (MPU, Wang et al. 2019; PU-GAN,
    Li et al. 2019) and on denoising (ScoreDenoise, Luo and Hu 2021) is such a cloud. The floor is the score of another
    one; it is a little over half of the floor of uniform samples, ``2 A / (pi N)`` for an area A.

    The spacing of the output dominates the score: points on the surface in clumps score worse than evenly spread ones
    with some noise. The output determines the size of the ground truth, so compare outputs of equal size. There are at
    most 200,000 samples. A reference that is a cloud is used as it is.
    """

    samples: int = 0  # of the reference; 0: as many as the output has points

    def score(self, output: PointCloud, case: Case) -> dict[str, float]:
        """``even_chamfer_l2_sum`` and ``even_hausdorff_sq_sum``: squared frame units."""
        if not len(output):
            return dict.fromkeys(("even_chamfer_l2_sum", "even_hausdorff_sq_sum"), float("inf"))
        pair = compare(output, case, self.samples or len(output), POISSON_DISK)
        forward, backward = pair.to_reference.distance**2, pair.to_output.distance**2
        return {
            "even_chamfer_l2_sum": float(forward.mean() + backward.mean()),
            "even_hausdorff_sq_sum": float(forward.max() + backward.max()),
        }

    def perfect(self, output: PointCloud, case: Case) -> PointCloud | Trimesh:
        """Another Poisson-disk sample, as large as the output."""
        return evenly_perfect(output, case)
