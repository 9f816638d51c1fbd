"""Normal consistency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register

from .normal_angle_deg import unit

if TYPE_CHECKING:
    from trimesh import Trimesh

    from bench.geometry.comparison import Comparison


@register("metric", version=1, better="higher", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree",))
@dataclass(frozen=True)
class NormalCosine:
    """Mean cosine between the normals of nearest points, average of both directions: unoriented, and oriented.

    ``normal_cosine = (mean_p |n_p . n_q(p)| + mean_q |n_q . n_p(q)|) / 2`` with q(p) the reference sample nearest to
    the output point p, and p(q) the other way: the "normal consistency" of Occupancy Networks (Mescheder et al. 2019).
    Random normals score 0.5. ``normal_cosine_oriented`` is the same without the absolute value, in -1..1: a surface
    turned inside out scores -1, random normals 0. Normals of a mesh are those of its faces.

    Both ends are samples, so near edges and where samples are sparse even a perfect output does not score 1: see
    the floor, and ``normal_angle_deg`` for exact closest points. Cosines hide small errors: 1 - cos of 8 degrees is
    0.01. A cloud without normals gets no score; normals of length zero are left out.
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``normal_cosine`` in 0..1 and ``normal_cosine_oriented`` in -1..1, or ``{}`` for a cloud without normals."""
        pair = case.compare(output)
        if pair.is_empty:
            return {"normal_cosine": 0.0, "normal_cosine_oriented": -1.0}
        cosines = nearest_cosines(pair)
        if cosines is None:
            return {}
        unoriented = sum(np.abs(c).mean() for c in cosines) / 2
        return {"normal_cosine": float(unoriented), "normal_cosine_oriented": float(sum(map(np.mean, cosines)) / 2)}


def nearest_cosines(pair: Comparison) -> tuple[np.ndarray, np.ndarray] | None:
    """The cosines between normals of output points and their nearest reference samples, and the other way round.

    None where either side has no normals; pairs in which one normal has length zero are left out.
    """
    if pair.output_normals is None or pair.reference_normals is None:
        return None
    ours, theirs = unit(pair.output_normals), unit(pair.reference_normals)
    forward = _cosines(ours, theirs[pair.to_reference.index])
    backward = _cosines(theirs, ours[pair.to_output.index])
    return (forward, backward) if len(forward) and len(backward) else None


def _cosines(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ni,ni->n", a, b)[a.any(axis=1) & b.any(axis=1)]
