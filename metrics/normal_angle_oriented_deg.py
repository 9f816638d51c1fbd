"""Angle between oriented normals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, register

from .normal_angle_deg import unit

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="lower", outputs=("mesh", "cloud"), floor=True, requires=("pykdtree", "igl"))
@dataclass(frozen=True)
class NormalAngleOrientedDeg:
    """Mean angle between oriented normals in degrees, average of both directions.

    ``normal_angle_deg`` with ``angle(a, b) = arccos(a . b)`` in 0..180: forward against the exact closest point of the
    reference surface, backward against the nearest output point. A surface turned inside out scores 180, random normals
    90. ``normal_flipped_share`` is the share of output points whose normal is more than 90 degrees from the surface's:
    0.5 for normals that were never oriented. On a thin sheet, right normals may count as flipped: the closest point of
    a point that has passed to the other side has the opposite normal. A cloud without normals gets no score.

    The winding of faces is used as it is, in the output and in the reference: a wrong winding of a result is what this
    metric measures. If the winding of the reference is wrong, its count of ``flipped_faces`` shows it
    (:mod:`topology`); then read the unoriented ``normal_angle_deg``.
    """

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """``normal_angle_oriented_deg`` in 0..180 and ``normal_flipped_share`` in 0..1, or ``{}`` without normals."""
        pair = case.compare(output)
        if pair.is_empty:
            return {"normal_angle_oriented_deg": 180.0, "normal_flipped_share": 1.0}
        if pair.output_normals is None:
            return {}
        normals, surface = unit(pair.output_normals), unit(pair.surface_normals)
        forward = oriented_angles(normals, surface)
        theirs = pair.reference_normals
        assert theirs is not None  # a reference that is a cloud has no surface_normals
        backward = oriented_angles(normals[pair.to_output.index], unit(theirs))
        if not len(forward) or not len(backward):
            return {}
        angle = (forward.mean() + backward.mean()) / 2
        return {"normal_angle_oriented_deg": float(angle), "normal_flipped_share": float((forward > 90).mean())}


def oriented_angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The angles in degrees between rows of two (n, 3) arrays of unit vectors; rows of zeros are left out.

    As ``2 atan2(|a - b|, |a + b|)``, which keeps all digits near 0 and near 180 degrees (Kahan 2006).
    """
    defined = a.any(axis=1) & b.any(axis=1)
    a, b = a[defined], b[defined]
    return np.degrees(2 * np.arctan2(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1)))
