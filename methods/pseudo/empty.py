"""No output at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import PointCloud, Run, register
from bench.geometry.hopeless import no_faces, no_points

if TYPE_CHECKING:
    import numpy as np
    from trimesh import Trimesh

    from bench import Views


@register("method", requires=("trimesh",))
@dataclass(frozen=True)
class Empty:
    """Nothing: breaks the contract of every task on purpose, so that all its cases are recorded as ``invalid``."""

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """No points."""
        return no_points()

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """No points."""
        return no_points()

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A mesh without vertices and faces."""
        return no_faces()

    def detail_transfer(self, source: Trimesh, source_base: Trimesh | None, target_base: Trimesh, run: Run) -> Trimesh:
        """A mesh without vertices and faces."""
        return no_faces()

    def fit_shape(self, views: Views, cloud: PointCloud, run: Run) -> PointCloud:
        """No points."""
        return no_points()

    def multiview(self, views: Views, run: Run) -> Trimesh:
        """A mesh without vertices and faces."""
        return no_faces()

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """A mesh without vertices and faces."""
        return no_faces()

    def pose_transfer(
        self,
        source: Trimesh,
        template: Trimesh,
        landmarks: Mapping[str, np.ndarray],
        target: Trimesh | PointCloud,
        run: Run,
    ) -> Trimesh:
        """A mesh without vertices and faces."""
        return no_faces()
