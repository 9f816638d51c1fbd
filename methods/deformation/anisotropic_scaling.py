"""Anisotropic scaling: the box of the source becomes the box of the target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import PointCloud, Run, register
from bench.geometry.used import used_vertices

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", cite="baseline of Wang et al. 2020", requires=("trimesh",))
@dataclass(frozen=True)
class AnisotropicScaling:
    """Scales the source along each axis so that its box is the target's, in size and in place.

    If the source is flat along an axis, it is only moved.
    """

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """The source, scaled."""
        given, wanted = (
            used_vertices(source),
            target.points if isinstance(target, PointCloud) else used_vertices(target),
        )
        (low, extent), (goal, size) = ((p.min(axis=0), np.ptp(p, axis=0)) for p in (given, wanted))
        scale = np.where(extent > 0, size / np.where(extent > 0, extent, 1), 1.0)
        output = source.copy()
        output.vertices = goal + size / 2 + (source.vertices - low - extent / 2) * scale
        return output
