"""How much a deformation changes the details of its source."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bench import Case, notice, register
from bench.geometry.laplacian import cotangent_laplacian, slivers
from bench.geometry.used import is_used, used_vertices

if TYPE_CHECKING:
    from trimesh import Trimesh


@register(
    "metric",
    version=1,
    length={"cot_laplacian": 1, "cot_laplacian_per_area": -1},
    better="lower",
    outputs=("mesh",),
    floor=True,
    requires=("scipy",),
)
@dataclass(frozen=True)
class CotLaplacian:
    """Change of the cotangent Laplacian from the source mesh to an output with the same faces.

    With L the cotangent Laplacian of the **source** (``L_ij = (cot a + cot b) / 2``, rows sum to zero, no division by
    areas), applied to both the source's vertices V and the output's V', and ``e_i = | |L V|_i - |L V'|_i |``:
    ``cot_laplacian = mean_i e_i`` in frame units, the CotLapNorm of Neural Cages (Wang et al. 2020);
    ``cot_laplacian_box`` the same in halves of the longest edge of the reference's box, the unit of that code;
    ``cot_laplacian_per_area = sum_i e_i / A`` with A the source's area, in 1 / frame units.

    The mean over vertices falls as the mesh is refined; the last form is the area-weighted mean of the change of
    ``|L V|_i / A_i``, twice the mean curvature, and converges with the resolution. L is not rebuilt on the output:
    the stretch of its triangles would change the weights. Lengths are compared, not vectors, so a rotation of any
    part costs nothing; scaling costs in proportion, and shearing along a flat part nothing. No target is needed: the
    unchanged source scores 0. As robust as a mean.

    Slivers of the source (:func:`bench.geometry.laplacian.slivers`: far thinner than the faces that make up its area)
    are left out, with a notice: their cotangents have no bound, so that one would decide the score. The code of Neural
    Cages adds 1e-10 under the root of Heron's formula instead. Vertices that no face with an area uses do not count.

    Scores ``{}`` without a ``source`` mesh in the case's input, or where the faces of the output differ from its faces.
    """

    def score(self, output: Trimesh, case: Case) -> dict[str, float]:
        """``cot_laplacian``, ``cot_laplacian_box``, ``cot_laplacian_per_area``; ``{}`` where they do not apply."""
        source: Any = case.input.get("source")
        if not hasattr(source, "faces") or not len(source.faces) or not np.array_equal(source.faces, output.faces):
            return {}
        thin = int(slivers(source.vertices, source.faces).sum())
        if thin:
            notice(
                f"cot_laplacian: {thin} of the {len(source.faces)} faces of the source are slivers; they are left out"
            )
        count = int(source.faces.max()) + 1  # after these, either mesh may have vertices that no face uses
        L = cotangent_laplacian(source.vertices[:count], source.faces)
        before, after = (np.linalg.norm(L @ np.asarray(mesh.vertices)[:count], axis=1) for mesh in (source, output))
        change = np.abs(before - after)[is_used(source)[:count]]
        half_edge = np.ptp(used_vertices(case.reference.mesh), axis=0).max() / 2
        return {
            "cot_laplacian": float(change.mean()),
            "cot_laplacian_box": float(change.mean() / half_edge),
            "cot_laplacian_per_area": float(change.sum() / source.area),
        }
