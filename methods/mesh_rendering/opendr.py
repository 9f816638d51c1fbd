"""OpenDR: the image moves with the surface that it shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import register

from .fitting.method import MeshFitting

if TYPE_CHECKING:
    from .raster.differences import DifferencesDrawn
    from .raster.scene import Scene


@register("method", cite="Loper and Black 2014", requires=("scipy", "numba", "open3d"))
@dataclass(frozen=True)
class Opendr(MeshFitting):
    """Deforms a mesh by plain images: differences of neighbouring pixels are the derivative by the surface's motion."""

    gap: float = 0.1  # neighbouring pixels whose depths differ by more show two surfaces

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.gap >= 0:
            raise ValueError(f"gap: expected at least 0, got {self.gap}")

    def draw(self, scene: Scene) -> DifferencesDrawn:
        """The plain image, with the gradient of differences."""
        from .raster.differences import DifferencesDrawn

        return DifferencesDrawn.of(scene, gap=self.gap)
