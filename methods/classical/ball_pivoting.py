"""Ball pivoting, by Open3D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import BadInput, PointCloud, Run, register

from .inputs import distinct_oriented
from .isolated import without_isolated

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", cite="Bernardini et al. 1999", requires=("open3d", "scipy", "trimesh"))
@dataclass(frozen=True)
class BallPivoting:
    """Ball pivoting: a ball rolls over the points, and the triples that it rests on become triangles."""

    radii: tuple[float, ...] = (1.5, 3.0, 6.0)  # of the balls, in mean spacings, ascending; larger ones close holes

    def __post_init__(self) -> None:
        radii = list(self.radii)
        if not radii or min(radii) <= 0 or radii != sorted(radii):
            raise ValueError(f"radii: expected ascending numbers above 0, got {radii}")

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A mesh through the points themselves: open where they are far apart, and as noisy as they are."""
        import open3d as o3d
        from trimesh import Trimesh

        from bench.geometry.spacing import mean_spacing

        cloud, _ = without_isolated(cloud, "ball_pivoting", run)
        points, normals, _ = distinct_oriented(cloud, "ball_pivoting", at_least=4)
        oriented = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        oriented.normals = o3d.utility.Vector3dVector(normals)
        radii = o3d.utility.DoubleVector(np.array(self.radii) * mean_spacing(points))
        mesh = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(oriented, radii)
        if not len(mesh.triangles):
            raise BadInput(
                f"ball_pivoting: no ball rests on three of the {len(points)} points; expected points that sample a "
                "surface densely (raise radii, or remove far outliers)"
            )
        return Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.triangles), process=False)
