"""Screened Poisson surface reconstruction, by Open3D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import PointCloud, Run, register

from .inputs import distinct_oriented

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", cite="Kazhdan and Hoppe 2013", requires=("open3d", "scipy", "trimesh"))
@dataclass(frozen=True)
class Poisson:
    """Screened Poisson surface reconstruction: the indicator function whose gradient fits the normals."""

    depth: int = 8  # octree depth, 5 to 12: 2^depth cells along the bounding cube
    trim: float = 0.0  # drop this quantile of least supported vertices, 0..1; opens what the method closes
    cut: float = 0.0  # drop vertices that lie so many octree levels below the median one; 0.7 opens holes, 0 keeps all
    point_weight: float = 4.0  # how strongly the surface is held to the points; 0 is unscreened Poisson
    scale: float = 1.1  # bounding cube of the reconstruction relative to that of the points
    samples_per_node: float = 1.5  # points per octree cell; 5 to 20 smooths noise away

    def __post_init__(self) -> None:
        # The library fills its octree to level 5; told to stop above, it reads nodes that are not there.
        if not 5 <= self.depth <= 12:
            raise ValueError(f"depth: expected 5 to 12, got {self.depth}")
        if not 0 <= self.trim < 1:
            raise ValueError(f"trim: expected a quantile from 0 to below 1, got {self.trim}")
        if not self.cut >= 0:
            raise ValueError(f"cut: expected at least 0, got {self.cut}")
        if not self.point_weight >= 0:
            raise ValueError(f"point_weight: expected at least 0, got {self.point_weight}")
        if not self.scale >= 1:
            raise ValueError(f"scale: expected at least 1, got {self.scale}")

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A closed surface; with ``trim`` or ``cut`` an open one where there were no points."""
        import open3d as o3d
        from trimesh import Trimesh

        points, normals, _ = distinct_oriented(cloud, "poisson", at_least=4)
        oriented = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        oriented.normals = o3d.utility.Vector3dVector(normals)
        # "Failed to close loop" and the like are about the octree, not about anything that the caller can change.
        with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
            mesh, support = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
                oriented,
                depth=self.depth,
                scale=self.scale,
                samples_per_node=self.samples_per_node,
                point_weight=self.point_weight,
                n_threads=1,  # with more, order and last digits change from run to run, and it is no faster
            )
        support = np.asarray(support)
        least = np.quantile(support, self.trim) if self.trim > 0 else -np.inf
        if self.cut > 0:
            least = max(least, np.median(support) - self.cut)
        mesh.remove_vertices_by_mask(support < least)
        return Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.triangles), process=False)

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """Exactly ``ratio`` times as many points of the reconstructed surface, evenly spread, with its normals."""
        from bench.geometry.mesh_surface import MeshSurface
        from bench.geometry.poisson_disk import CANDIDATES, eliminate

        mesh = self.reconstruct(cloud, run)
        count = ratio * len(cloud)
        return PointCloud(*eliminate(*MeshSurface(mesh).sample(CANDIDATES * count, run.rng), mesh, count))
