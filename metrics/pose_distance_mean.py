"""How far each vertex of a posed character is from the same vertex of the truth, after both are centred."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, register
from bench.geometry.used import is_used

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, length=1, better="lower", outputs=("mesh",), floor=True, requires=("trimesh",))
@dataclass(frozen=True)
class PoseDistanceMean:
    """Mean distance between a vertex of the output and the same vertex of the reference, once both have one centre.

    ``mean_i |(v_i - v) - (r_i - r)|`` over the vertices that a face uses, in frame units, with v and r the means of
    these vertices. Like ``vertex_distance_mean``, but translations do not count; rotations do. As robust as a mean.
    Scores ``{}`` where the faces of output and reference differ.
    """

    def score(self, output: Trimesh, case: Case) -> dict[str, float]:
        """``pose_distance_mean``; ``{}`` where it does not apply."""
        reference = case.reference.mesh
        if not len(output.faces) or not np.array_equal(output.faces, reference.faces):
            return {}
        used = np.flatnonzero(is_used(reference))
        apart = np.asarray(output.vertices)[used] - np.asarray(reference.vertices)[used]
        return {"pose_distance_mean": float(np.linalg.norm(apart - apart.mean(axis=0), axis=1).mean())}
