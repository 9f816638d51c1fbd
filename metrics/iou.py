"""Volumetric intersection over union."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, generator, register
from bench.geometry.orientation import NoSides, oriented
from bench.geometry.topology import count_topology
from bench.geometry.used import used_vertices
from bench.geometry.winding import inside

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="higher", outputs=("mesh",), floor=True, requires=("igl", "scipy"))
@dataclass(frozen=True)
class Iou:
    """Volume of the intersection over volume of the union, estimated at seeded points.

    ``|A and B| / |A or B|`` over points drawn uniformly in the common bounding box of the output A and the reference
    B; inside is where the generalised winding number (Jacobson et al. 2013, by libigl's fast approximation) exceeds
    one half in absolute value. In 0..1; with n points in the union the standard error is ``sqrt(iou (1 - iou) / n)``.
    Occupancy Networks (Mescheder et al. 2019) report it from 100,000 points.

    Only where the reference is closed. An open output counts with the volume that its winding number encloses: a
    sphere with a small hole is nearly whole, a half sphere is closed by a soft lid, a flat sheet has none and scores 0.
    Faces are first wound consistently and outward where they are not, and copies of a face count once
    (:func:`bench.geometry.orientation.oriented`); where that cannot be done, the score is left out. Robust to small
    floating pieces and to all thin parts, which hardly change it; a single far vertex enlarges the box and leaves few
    points for the shape, in the end none, which scores 0.
    """

    samples: int = 100_000  # points in the common bounding box

    def score(self, output: Trimesh, case: Case) -> dict[str, float]:
        """``{"iou": 0..1}``, or ``{}`` where the reference is open, or a mesh has no inside: see :meth:`why_not`."""
        try:
            solids = _solids(output, case)
        except NoSides:
            return {}
        if case.compare(output).is_empty:
            return {"iou": 0.0}
        corners = np.vstack([used_vertices(mesh) for mesh in (output, case.reference.mesh)])
        rng = generator(case.seed, case.id, "iou")
        points = rng.uniform(corners.min(axis=0), corners.max(axis=0), (self.samples, 3))
        ours, theirs = (inside(vertices, faces, points) for vertices, faces in solids)
        union = (ours | theirs).sum()
        return {"iou": float((ours & theirs).sum() / union) if union else 0.0}

    def why_not(self, output: Trimesh, case: Case) -> str:
        """Why an output has no score."""
        if case.reference.cloud is not None:
            return "needs a reference that is a mesh"
        try:
            _solids(output, case)
        except NoSides as error:
            return str(error)
        return ""


def _solids(output: Trimesh, case: Case) -> list[tuple[np.ndarray, np.ndarray]]:
    """Vertices and oriented faces of the output and of the reference, or :class:`NoSides` if one is not a solid."""
    found = []
    for name, mesh in (("output", output), ("reference", case.reference.mesh)):
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        try:
            faces = oriented(vertices, faces) if len(faces) else faces
        except NoSides as error:
            raise NoSides(f"the {name} has no inside: {error}") from None
        found.append((vertices, faces))
    if not count_topology(*found[1]).watertight:
        raise NoSides("the reference is not closed: it has edges that do not belong to exactly two faces")
    return found
