"""No output at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import PointCloud, Run, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", requires=("trimesh",))
@dataclass(frozen=True)
class Empty:
    """Nothing: breaks every task's promise on purpose, so that all its cases are recorded as ``invalid``."""

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """No points."""
        return PointCloud(np.empty((0, 3)))

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """No points."""
        return PointCloud(np.empty((0, 3)))

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A mesh without vertices and faces."""
        return _no_mesh()

    def detail_transfer(self, source: Trimesh, source_base: Trimesh | None, target_base: Trimesh, run: Run) -> Trimesh:
        """A mesh without vertices and faces."""
        return _no_mesh()


def _no_mesh() -> Trimesh:
    from trimesh import Trimesh

    return Trimesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64), process=False)
