"""Ball pivoting, by Open3D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import BadInput, PointCloud, Run, register

from .inputs import distinct_oriented
from .isolated import without_isolated
from .noise import noise_to_spacing

if TYPE_CHECKING:
    from trimesh import Trimesh

NOISY = 0.15  # ratio of noise to spacing above which small balls are harmful


@register("method", cite="Bernardini et al. 1999", requires=("open3d", "scipy", "trimesh"))
@dataclass(frozen=True)
class BallPivoting:
    """Ball pivoting: a ball rolls over the points, and the triples that it rests on become triangles."""

    radii: tuple[float, ...] | None = None  # of the balls, in mean spacings, ascending; None: by the noise

    def __post_init__(self) -> None:
        if self.radii is None:
            return
        radii = list(self.radii)
        if not radii or min(radii) <= 0 or radii != sorted(radii):
            raise ValueError(f"radii: expected ascending numbers above 0, got {radii}")

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A mesh with the points as vertices: open where they are far apart, and as noisy as they are."""
        import open3d as o3d
        from trimesh import Trimesh

        from bench.geometry.spacing import mean_spacing

        cloud, _ = without_isolated(cloud, "ball_pivoting", run)
        points, normals, _ = distinct_oriented(cloud, "ball_pivoting", at_least=4)
        oriented = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        oriented.normals = o3d.utility.Vector3dVector(normals)
        balls = radii_for(points, normals) if self.radii is None else self.radii
        radii = o3d.utility.DoubleVector(np.array(balls) * mean_spacing(points))
        mesh = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(oriented, radii)
        if not len(mesh.triangles):
            raise BadInput(
                f"ball_pivoting: no ball rests on three of the {len(points)} points; expected points that sample a "
                "surface densely (raise radii, or remove far outliers)"
            )
        return Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.triangles), process=False)


def radii_for(points: np.ndarray, normals: np.ndarray) -> tuple[float, ...]:
    """The radii that were best on the train shapes at the noise of these points, see docs/tuning.md.

    A ball smaller than the noise rests on protruding points.
    """
    return (1.0, 1.5, 2.0, 4.0) if noise_to_spacing(points, normals) < NOISY else (1.5, 3.0, 6.0)
