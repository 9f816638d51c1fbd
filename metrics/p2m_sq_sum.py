"""Point-to-mesh distance as the denoising papers define it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register
from bench.geometry.sampling import face_normals
from bench.geometry.triangles import triangles_to_points

if TYPE_CHECKING:
    from trimesh import Trimesh


@register(
    "metric", version=1, length=2, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("igl", "scipy")
)
@dataclass(frozen=True)
class P2mSqSum:
    """Mean squared point-to-face distance plus mean squared face-to-point distance.

    ``mean_p min_f d(p, f)^2 + mean_f min_p d(p, f)^2`` over output points p and faces f of the reference mesh, with
    d the exact distance of a point to a triangle, in squared frame units: the "P2M" of ScoreDenoise (Luo and Hu 2021),
    IterativePFN and StraightPCF. They use pytorch3d's, which treats small triangles (area below 0.005) as segments and
    so measures distances to edges on dense meshes; here every triangle counts as a triangle.

    Every face with an area counts the same, whatever its size: finely tessellated parts weigh more, and the score
    depends on the mesh. The second term rewards dense outputs. One outlier among N adds its squared distance / N.
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``{"p2m_sq_sum": squared frame units}``."""
        pair = case.compare(output)
        if pair.is_empty:
            return {"p2m_sq_sum": float("inf")}
        forward = pair.to_surface.distance
        mesh = case.reference.mesh
        faces = np.asarray(mesh.faces)[face_normals(mesh).any(axis=1)]
        backward = triangles_to_points(np.asarray(mesh.vertices)[faces], pair.output_points)
        return {"p2m_sq_sum": float((forward**2).mean() + (backward**2).mean())}
