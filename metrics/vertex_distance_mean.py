"""How far each vertex of an output is from the same vertex of the reference."""

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
class VertexDistanceMean:
    """Mean distance between a vertex of the output and the vertex of the reference with the same number.

    ``mean_i |v_i - r_i|`` over the vertices that a face uses, in frame units: the error of correspondence of a
    deformation. It detects slipping along the surface, which distances between surfaces do not. As robust as a mean.
    Scores ``{}`` where the faces of output and reference differ: then no correspondence is known.
    """

    def score(self, output: Trimesh, case: Case) -> dict[str, float]:
        """``vertex_distance_mean``; ``{}`` where it does not apply."""
        reference = case.reference.mesh
        if not len(output.faces) or not np.array_equal(output.faces, reference.faces):
            return {}
        count = int(reference.faces.max()) + 1  # after these, either mesh may have vertices that no face uses
        ours, theirs = (np.asarray(mesh.vertices)[:count] for mesh in (output, reference))
        apart = np.linalg.norm(ours - theirs, axis=1)
        return {"vertex_distance_mean": float(apart[is_used(reference)[:count]].mean())}
