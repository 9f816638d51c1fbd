"""Hausdorff distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, PointCloud, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register(
    "metric", version=1, length=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree", "igl")
)
@dataclass(frozen=True)
class Hausdorff:
    """Largest nearest-neighbour distance of both directions, unsquared.

    ``max(max_p min_q |p - q|, max_q min_p |p - q|)`` over output points p and reference samples q, in frame units. The
    vertices of meshes count too, by their exact distance to the other mesh (or to the nearest point of a cloud), as in
    Metro (Cignoni et al. 1998): samples miss a spike without an area. Points2Surf (Erler et al. 2020) reports it from
    samples only, which is ``hausdorff@N``; MPU's tables hold the sum of both squared maxima of samples,
    ``hausdorff_sq_sum``. One outlier decides it.

    Example
    -------
    >>> from bench import Shape
    >>> from trimesh.creation import icosphere
    >>> case = Case("ball", {}, Shape("ball", icosphere(subdivisions=3)))
    >>> scores = Hausdorff().score(icosphere(subdivisions=3, radius=1.1), case)
    >>> round(scores["hausdorff"], 2)
    0.1
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``{"hausdorff": frame units}``."""
        pair = case.compare(output)
        return {"hausdorff": max(pair.to_reference_max, pair.to_output_max)}
