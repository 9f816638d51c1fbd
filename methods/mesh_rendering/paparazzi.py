"""Paparazzi: normals follow the shading, silhouettes have no effect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import register

from .fitting.method import MeshFitting

if TYPE_CHECKING:
    from .raster.hard import HardDrawn
    from .raster.scene import Scene


@register("method", cite="Liu et al. 2018", requires=("scipy", "numba", "open3d"))
@dataclass(frozen=True)
class Paparazzi(MeshFitting):
    """Deforms a mesh by the shading of plain images alone: made for editing surfaces, it cannot change an outline."""

    def draw(self, scene: Scene) -> HardDrawn:
        """The plain image, with the gradient of its colours."""
        from .raster.hard import HardDrawn

        return HardDrawn.of(scene)
