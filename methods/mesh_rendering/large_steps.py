"""Large steps: the gradient of the soft rasteriser, diffused over the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import register

from .soft_rasterizer import SoftRasterizer

if TYPE_CHECKING:
    from .fitting.descent import Diffused


@register("method", cite="Nicolet et al. 2021", requires=("scipy", "numba", "open3d"))
@dataclass(frozen=True)
class LargeSteps(SoftRasterizer):
    """Deforms a mesh in coordinates u = (I + lambda L) v, in which steps are smooth, without a regulariser."""

    rate: float = 0.3  # of the descent: about the longest step of a coordinate u
    smoothness: float = 0.0  # weight of the Laplacian
    evenness: float = 0.0  # weight of the variance of the edges' lengths
    diffusion: float = 19.0  # lambda; with more vertices, the same length of diffusion needs a larger one

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.diffusion >= 0:
            raise ValueError(f"diffusion: expected at least 0, got {self.diffusion}")

    def coordinates(self, faces: np.ndarray, count: int) -> Diffused:
        """u, with the matrix factorised."""
        from .fitting.descent import Diffused

        return Diffused(faces, count, self.diffusion)
