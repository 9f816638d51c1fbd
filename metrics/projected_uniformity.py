"""How evenly a cloud is spread over the surface, as the script of PU-GAN computes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register
from bench.geometry.reference_sample import evenly_perfect

from .uniformity import SHARES, Disks, check_disks, disk_centers

if TYPE_CHECKING:
    from trimesh import Trimesh


@register(
    "metric", version=1, length=1, better="lower", outputs=("cloud",), floor=True, requires=("igl", "scipy", "open3d")
)
@dataclass(frozen=True)
class ProjectedUniformity:
    """Uniformity of the points projected to the reference mesh, over the disks that hold at least five of them.

    The formula of ``uniformity`` with two differences, both of PU-GAN's script (Li et al. 2019): each output point is
    first moved to the closest point of the reference mesh, and a disk with fewer than ``least`` points is left out of
    the mean. In frame units. Disks are Euclidean balls where the script has geodesic ones: on thin sheets and near
    contacts they collect both sides. The floor is that of a Poisson-disk sample.

    After the projection, noise no longer spreads the points, so a noisy cloud scores worse than by ``uniformity``.
    Leaving out disks favours holes: the disks within them do not count. Not defined, and left out, where no disk holds
    ``least`` points: for the smallest shares, with outputs of fewer than about 1,000 points.
    """

    shares: tuple[float, ...] = SHARES  # areas of the disks as shares of the surface
    disks: int = 1000  # number of disks of each size
    least: int = 5  # points that a disk must hold to count

    def __post_init__(self) -> None:
        check_disks(self.shares, self.disks)
        if self.least < 2:
            raise ValueError(f"least: expected at least 2 (fewer points have no spacing), got {self.least}")

    def score(self, output: PointCloud, case: Case) -> dict[str, float]:
        """``projected_uniformity@s`` for each share s that has a disk with enough points: frame units."""
        if not len(output):
            return {f"projected_uniformity@{share:g}": float("inf") for share in self.shares}
        pair = case.compare(output)
        disks = Disks(pair.to_surface.points, disk_centers(case, self.disks))
        scores = {}
        for share in self.shares:
            counts, unevenness = disks.unevenness(share, pair.reference_area)
            if (counts >= self.least).any():
                scores[f"projected_uniformity@{share:g}"] = float(np.mean(unevenness[counts >= self.least]))
        return scores

    def perfect(self, output: PointCloud, case: Case) -> PointCloud | Trimesh:
        """A Poisson-disk sample as large as the output."""
        return evenly_perfect(output, case)
