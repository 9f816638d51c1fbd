"""Faces of an output that pass through each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, register
from bench.geometry.self_intersections import self_intersecting_faces

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="lower", outputs=("mesh",), floor=True, requires=("trimesh",))
@dataclass(frozen=True)
class SelfIntersections:
    """Number and share of the faces that cross another face of the same mesh.

    Two faces cross where an edge of one passes through the inside of the other, or where two that share one vertex
    meet elsewhere too; :mod:`bench.geometry.self_intersections` has the predicate. In float64: touching and coplanar
    overlap do not count, so two copies of one sheet are not found. Vertices at equal positions count as one.
    ``self_intersecting_share`` is over all faces. A finer mesh has more faces along the same crossing: compare counts
    at similar resolution. It says nothing about the shape: a perfect sphere in the wrong place has none.
    """

    def score(self, output: Trimesh, case: Case) -> dict[str, float]:
        """``self_intersecting_faces``, a count, and ``self_intersecting_share`` in 0..1."""
        if not len(output.faces):
            return {"self_intersecting_faces": float("inf"), "self_intersecting_share": 1.0}
        crossing = self_intersecting_faces(output.vertices, output.faces)
        return {"self_intersecting_faces": float(crossing.sum()), "self_intersecting_share": float(crossing.mean())}
