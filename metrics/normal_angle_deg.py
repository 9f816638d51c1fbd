"""Angle between normals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree", "igl"))
@dataclass(frozen=True)
class NormalAngleDeg:
    """Mean angle between unoriented normals in degrees, average of both directions.

    ``(mean_p angle(n_p, n(x_p)) + mean_q angle(n_q, n_p(q))) / 2`` with ``angle(a, b) = arccos |a . b|``: forward, the
    normal of each output point p against that of the reference surface at its exact closest point x_p; backward, the
    normal of each reference sample q against that of its nearest output point p(q). The pairing of the normal
    consistency of Occupancy Networks (Mescheder et al. 2019), forward without its sampling, and as an angle, which
    resolves small errors. Random normals score 57.3 degrees (one radian).

    A surface that the dataset knows exactly has its own normals, not those of the faces of its tessellation. Where the
    closest point lies on an edge, the normal of any one of its faces counts. Normals of length zero have no direction
    and are left out of the mean. A cloud without normals gets no score.
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``{"normal_angle_deg": degrees in 0..90}``, or ``{}`` for a cloud without normals."""
        pair = case.compare(output)
        if pair.is_empty:
            return {"normal_angle_deg": 90.0}
        if pair.output_normals is None:
            return {}
        normals = unit(pair.output_normals)
        forward = mean_angle(normals, unit(pair.surface_normals))
        theirs = pair.reference_normals
        assert theirs is not None  # a reference that is a cloud has no surface_normals
        backward = mean_angle(normals[pair.to_output.index], unit(theirs))
        both = (forward + backward) / 2
        return {"normal_angle_deg": both} if np.isfinite(both) else {}


def mean_angle(a: np.ndarray, b: np.ndarray) -> float:
    """The mean unoriented angle in degrees between rows of two (n, 3) arrays of unit vectors; NaN if none has any.

    As ``2 arcsin(|a - b| / 2)``: near zero, arccos of the scalar product would lose half of the digits.
    """
    towards, away = np.einsum("ni,ni->n", a - b, a - b), np.einsum("ni,ni->n", a + b, a + b)
    halved = np.sqrt(np.minimum(towards, away)) / 2
    angles = np.degrees(2 * np.arcsin(np.minimum(halved, np.sqrt(0.5))))
    defined = a.any(axis=1) & b.any(axis=1)
    return float(angles[defined].mean()) if defined.any() else float("nan")


def unit(normals: np.ndarray) -> np.ndarray:
    """Rows scaled to length 1; rows of zeros stay."""
    lengths = np.sqrt(np.einsum("ni,ni->n", normals, normals))[:, None]
    return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
