"""Soft rasteriser: faces with blurred edges and blended depths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import register

from .fitting.method import MeshFitting

if TYPE_CHECKING:
    from .raster.scene import Scene
    from .raster.soft import SoftDrawn


@register("method", cite="Liu et al. 2019", requires=("scipy", "numba", "open3d"))
@dataclass(frozen=True)
class SoftRasterizer(MeshFitting):
    """Deforms a mesh by images whose pixels see all faces near them, by distance and depth: an exact gradient."""

    sigma: float = 1e-4  # blur of the edges, in squared half widths of the image (released: 1e-4)
    gamma: float = 0.01  # blur of the depths; the shape has the radius 1 (released: 1e-4 of 99 units)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("sigma", "gamma"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")

    def draw(self, scene: Scene) -> SoftDrawn:
        """The soft image."""
        from .raster.soft import SoftDrawn

        return SoftDrawn.of(scene, self.sigma, self.gamma)
