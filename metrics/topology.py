"""Topology counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, register
from bench.geometry.topology import count_topology

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="reference", outputs=("mesh",), floor=True, requires=("scipy",))
@dataclass(frozen=True)
class Topology:
    """Connected components, genus, boundary edges, watertightness and flipped faces.

    The nearer to the reference's own counts (in place of the floor) the better. Vertices at exactly equal positions
    count as one; formulas in :mod:`bench.geometry.topology`. The genus is left out where it is not defined: for
    surfaces that are not manifold or not orientable. ``flipped_faces`` is the smallest number of faces to flip so that
    neighbours agree which side is outside; 0 does not mean that this side is the right one. It is left out for a
    surface that is not orientable, such as a Moebius strip.
    """

    def score(self, output: Trimesh, case: Case) -> dict[str, float]:
        """``components``, ``genus`` (if defined), ``boundary_edges``, ``watertight`` as 0 or 1, ``flipped_faces``."""
        counts = count_topology(output.vertices, output.faces)
        return {name: float(value) for name, value in counts._asdict().items() if value is not None}
