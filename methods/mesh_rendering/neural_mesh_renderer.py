"""Neural mesh renderer: its gradient lets edges sweep over the pixels of their rows and columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import register

from .fitting.method import MeshFitting

if TYPE_CHECKING:
    from .raster.scan_lines import ScanLineDrawn
    from .raster.scene import Scene


@register("method", cite="Kato et al. 2018", requires=("scipy", "numba", "open3d"))
@dataclass(frozen=True)
class NeuralMeshRenderer(MeshFitting):
    """Deforms a mesh by plain images: a pixel's change is spread over the way of the edge that would cause it."""

    gap: float = 0.05  # pixels of a surface that is nearer by more do not change

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.gap >= 0:
            raise ValueError(f"gap: expected at least 0, got {self.gap}")

    def draw(self, scene: Scene) -> ScanLineDrawn:
        """The plain image, with the gradient along scan lines."""
        from .raster.scan_lines import ScanLineDrawn

        return ScanLineDrawn.of(scene, gap=self.gap)
