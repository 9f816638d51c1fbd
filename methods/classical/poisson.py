"""Screened Poisson surface reconstruction, by Open3D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import PointCloud, Run, register

from . import screened_poisson
from .inputs import distinct_oriented, note_coarse, note_flat
from .isolated import without_isolated
from .noise import noise_to_spacing

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", cite="Kazhdan and Hoppe 2013", requires=("open3d", "scipy", "trimesh"))
@dataclass(frozen=True)
class Poisson:
    """Screened Poisson surface reconstruction: the indicator function whose gradient fits the normals.

    The less noise, the higher the point weight. With ``point_weight=2`` this is Open3D's plain call.
    """

    depth: int = 8  # octree depth, 5 to 12: 2^depth cells along the bounding cube
    trim: float = 0.0  # drop this quantile of least supported vertices, 0..1; opens holes that the method closes
    cut: float = 0.0  # drop vertices this many octree levels below the median one; 0.7 opens holes, 0 keeps all
    point_weight: float | None = None  # how strongly points hold the surface; 0: not; None: by their noise, 0.3 to 10
    scale: float = 1.1  # bounding cube of the reconstruction relative to that of the points
    samples_per_node: float = 1.5  # points per octree cell; 5 to 20 smooths noise away
    linear_fit: bool = False  # whether vertices are set by linear interpolation along the edges of the octree

    def __post_init__(self) -> None:
        screened_poisson.check_octree(self.depth, self.scale, self.point_weight or 0.0, self.samples_per_node)
        if not 0 <= self.trim < 1:
            raise ValueError(f"trim: expected a quantile from 0 to below 1, got {self.trim}")
        if not self.cut >= 0:
            raise ValueError(f"cut: expected at least 0, got {self.cut}")

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A closed surface; with ``trim`` or ``cut`` an open one where there were no points."""
        from trimesh import Trimesh

        cloud, _ = without_isolated(cloud, "poisson", run)
        points, normals, _ = distinct_oriented(cloud, "poisson", at_least=4)
        weight = weight_for(points, normals) if self.point_weight is None else self.point_weight
        note_coarse(points, 2**self.depth / self.scale, "poisson", "depth", run)
        note_flat(points, "poisson", run, "the surface continues beyond them, to the border of the box")
        vertices, faces, support = screened_poisson.solve(
            points,
            normals,
            depth=self.depth,
            scale=self.scale,
            samples_per_node=self.samples_per_node,
            point_weight=weight,
            linear_fit=self.linear_fit,
        )
        least = np.quantile(support, self.trim) if self.trim > 0 else -np.inf
        if self.cut > 0:
            least = max(least, np.median(support) - self.cut)
        kept = support >= least
        faces = (np.cumsum(kept) - 1)[faces[kept[faces].all(axis=1)]]
        return Trimesh(vertices[kept], faces, process=False)

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """Exactly ``ratio`` times as many points of the reconstructed surface, evenly spread, with its normals."""
        from bench.geometry.mesh_surface import MeshSurface
        from bench.geometry.poisson_disk import CANDIDATES, eliminate

        mesh = self.reconstruct(cloud, run)
        count = ratio * len(cloud)
        return PointCloud(*eliminate(*MeshSurface(mesh).sample(CANDIDATES * count, run.rng), mesh, count))


def weight_for(points: np.ndarray, normals: np.ndarray) -> float:
    """The weight that was best on the train shapes at the noise of these points, see docs/tuning.md."""
    return float(np.clip(0.26 / max(noise_to_spacing(points, normals), 1e-9), 0.3, 10.0))
