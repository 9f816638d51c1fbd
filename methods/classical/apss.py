"""Algebraic point set surfaces, by MeshLab."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import PointCloud, Run, register

from . import mls

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", cite="Guennebaud and Gross 2007", requires=("pymeshlab", "scipy", "trimesh"))
@dataclass(frozen=True)
class Apss:
    """Algebraic point set surfaces: moving least squares with spheres instead of planes.

    MeshLab's own call has ``filterscale=2``, ``resolution=200``, ``reach=0`` and ``steps=15``, and
    stops the latter early.
    """

    filterscale: float | None = None  # support in local spacings; larger smooths more; None: by the noise, 1.6 to 6
    spherical: float = 1.0  # 1 fits spheres, 0 planes
    resolution: int = 200  # marching cubes cells along the longest side of the bounding box (reconstruct)
    reach: float = 2.0  # local spacings from the points, beyond which a surface is dropped; 0: never (reconstruct)
    steps: int = 4  # of the projection; MeshLab's 15 change the mean by 5e-5 at 2 % noise, by nothing without noise

    def __post_init__(self) -> None:
        mls.check_parameters(self.filterscale, self.resolution, self.steps, self.reach)

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """Every point projected to the surface."""
        return mls.project(
            cloud, "apss", run, self.steps, filterscale=self.filterscale, sphericalparameter=self.spherical
        )

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """Exactly ``ratio`` times as many points: midpoints between neighbours, projected and evenly thinned."""
        return mls.upsample(
            cloud, ratio, "apss", run, self.steps, filterscale=self.filterscale, sphericalparameter=self.spherical
        )

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """The surface by marching cubes; open where points are missing."""
        return mls.isosurface(
            cloud,
            "apss",
            run,
            self.resolution,
            self.steps,
            self.reach,
            filterscale=self.filterscale,
            sphericalparameter=self.spherical,
        )
