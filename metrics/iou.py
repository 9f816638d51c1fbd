"""Volumetric intersection over union."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, generator, register
from bench.geometry.topology import count_topology
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

    Only where the reference is closed. An open output counts with the volume that its winding number closes in: a
    sphere with a small hole is nearly whole, a half sphere is closed by a soft lid, a flat sheet has none and scores
    0. Robust to small floating pieces and to all that is thin, which it hardly sees; a single far vertex blows up the
    box and leaves few points for the shape, in the end none, which scores 0.
    """

    samples: int = 100_000  # points in the common bounding box

    def score(self, output: Trimesh, case: Case) -> dict[str, float]:
        """``{"iou": 0..1}``, or ``{}`` where the reference is open."""
        reference = case.reference.mesh
        if not count_topology(reference.vertices, reference.faces).watertight:
            return {}
        if case.compare(output).is_empty:
            return {"iou": 0.0}
        corners = np.vstack([mesh.vertices[mesh.faces.ravel()] for mesh in (output, reference)])
        rng = generator(case.seed, case.id, "iou")
        points = rng.uniform(corners.min(axis=0), corners.max(axis=0), (self.samples, 3))
        ours, theirs = (inside(mesh.vertices, mesh.faces, points) for mesh in (output, reference))
        union = (ours | theirs).sum()
        return {"iou": float((ours & theirs).sum() / union) if union else 0.0}
