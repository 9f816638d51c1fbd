"""Random points, independent of the input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import PointCloud, Run, register
from bench.geometry.check import check_points
from bench.geometry.hopeless import SIZE, random_cloud, random_triangles

if TYPE_CHECKING:
    import numpy as np
    from trimesh import Trimesh

    from bench import Views


@register("method", requires=("trimesh",))
@dataclass(frozen=True)
class Noise:
    """Uniform random points in the unit ball: every method must do better."""

    size: float = SIZE  # of the triangles that stand for points in a mesh, in the unit of the frame

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the input has."""
        check_points(cloud.points, "noise")
        return PointCloud(random_cloud(len(cloud), run.rng).points)

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """``ratio`` times as many points as the input has."""
        check_points(cloud.points, "noise")
        return PointCloud(random_cloud(ratio * len(cloud), run.rng).points)

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """As many tiny triangles, turned at random, as the input has points."""
        check_points(cloud.points, "noise")
        return random_triangles(len(cloud), run.rng, self.size)

    def detail_transfer(self, source: Trimesh, source_base: Trimesh | None, target_base: Trimesh, run: Run) -> Trimesh:
        """As many tiny triangles, turned at random, as the target's base has vertices."""
        return random_triangles(len(target_base.vertices), run.rng, self.size)

    def fit_shape(self, views: Views, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the initial cloud has."""
        return PointCloud(random_cloud(len(cloud), run.rng).points)

    def multiview(self, views: Views, run: Run) -> Trimesh:
        """1,000 triangles at random places, with random orientations."""
        return random_triangles(1000, run.rng, self.size)

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """The faces of the source between random vertices."""
        output = source.copy()
        output.vertices = random_cloud(len(source.vertices), run.rng).points
        return output

    def pose_transfer(
        self,
        source: Trimesh,
        template: Trimesh,
        landmarks: Mapping[str, np.ndarray],
        target: Trimesh | PointCloud,
        run: Run,
    ) -> Trimesh:
        """The faces of the character between random vertices."""
        return self.deform(source, target, run)
