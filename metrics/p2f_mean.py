"""Point-to-face distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, PointCloud, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, length=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("igl",))
@dataclass(frozen=True)
class P2fMean:
    """Mean exact distance of the output's points to the reference mesh (point to face).

    ``mean_p min_(x on the mesh) |p - x|`` over the points of a cloud, or over uniform samples of a mesh, unsquared, in
    frame units: the P2F of PU-Net and MPU. Exact to rounding, without sampling of the reference. It is one-sided: an
    output that covers half of the shape can be perfect. Where the dataset has a smooth surface, its mesh is a fine
    tessellation, and the floor is the distance of exact points to that mesh.
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``{"p2f_mean": frame units}``."""
        return {"p2f_mean": float(case.compare(output).to_surface.distance.mean())}
