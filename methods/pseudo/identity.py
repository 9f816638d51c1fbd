"""The input, unchanged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import PointCloud, Run, register
from bench.geometry.check import check_points

if TYPE_CHECKING:
    from trimesh import Trimesh

    from bench import Views


@register("method", requires=("scipy", "trimesh"))
@dataclass(frozen=True)
class Identity:
    """The input unchanged: what every method has to beat."""

    size: float = 0.01  # of the triangles that stand for points in a mesh, relative to the mean spacing

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """The cloud itself."""
        check_points(cloud.points, "identity")
        return cloud

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """Every point ``ratio`` times."""
        check_points(cloud.points, "identity")
        parts = (cloud.normals, cloud.colors)
        normals, colors = (None if part is None else np.repeat(part, ratio, axis=0) for part in parts)
        return PointCloud(np.repeat(cloud.points, ratio, axis=0), normals, colors)

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A tiny triangle around every point, in its tangent plane: its distances are those of the cloud."""
        from bench.geometry.normals import with_normals
        from bench.geometry.spacing import mean_spacing
        from bench.geometry.tiny_triangles import triangles_around

        check_points(cloud.points, "identity", at_least=3)
        normals = with_normals(cloud).normals
        assert normals is not None
        return triangles_around(cloud.points, normals, self.size * mean_spacing(cloud.points))

    def detail_transfer(self, source: Trimesh, source_base: Trimesh | None, target_base: Trimesh, run: Run) -> Trimesh:
        """The target's base without any details."""
        return target_base.copy()

    def fit_shape(self, views: Views, cloud: PointCloud, run: Run) -> PointCloud:
        """The initial cloud."""
        return cloud

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """The source itself."""
        return source.copy()

    def pose_transfer(
        self,
        source: Trimesh,
        template: Trimesh,
        landmarks: Mapping[str, np.ndarray],
        target: Trimesh | PointCloud,
        run: Run,
    ) -> Trimesh:
        """The character at rest."""
        return source.copy()
