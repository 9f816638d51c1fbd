"""Points that know nothing of the input."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import PointCloud, Run, register
from bench.geometry.check import check_points

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", requires=("trimesh",))
@dataclass(frozen=True)
class Noise:
    """Uniform random points in the unit ball: what no method may fall behind."""

    size: float = 0.001  # of the triangles that stand for points in a mesh, in the unit of the frame

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the input has."""
        check_points(cloud.points, "noise")
        return PointCloud(_in_ball(len(cloud), run.rng))

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """``ratio`` times as many points as the input has."""
        check_points(cloud.points, "noise")
        return PointCloud(_in_ball(ratio * len(cloud), run.rng))

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """As many tiny triangles, turned at random, as the input has points."""
        from .triangles import triangles_around

        check_points(cloud.points, "noise")
        points = _in_ball(len(cloud), run.rng)
        return triangles_around(points, _directions(len(cloud), run.rng), self.size)

    def detail_transfer(self, source: Trimesh, source_base: Trimesh | None, target_base: Trimesh, run: Run) -> Trimesh:
        """As many tiny triangles, turned at random, as the target's base has vertices."""
        return self.reconstruct(PointCloud(target_base.vertices), run)


def _in_ball(count: int, rng: np.random.Generator) -> np.ndarray:
    # The volume within radius r grows with its cube.
    return _directions(count, rng) * np.cbrt(rng.random((count, 1)))


def _directions(count: int, rng: np.random.Generator) -> np.ndarray:
    directions = rng.standard_normal((count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)
