"""An ideal depth camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import register

from .checks import expect_count
from .scanning import Scan, Scanner
from .scene import Scene, focal_length, see
from .views import Pose


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class DepthCamera(Scanner):
    """Depth images without error: only visible points, denser where the surface is near and faces the camera.

    The points lie on the mesh. Add effects after it in a ``chain`` for noise of any kind.
    """

    resolution: int = 64  # pixels along each side of the image, which the bounding sphere fills
    normals: Literal["pca", "exact", "none"] = "exact"  # estimated and turned to the camera, exact at the hit, or none

    def __post_init__(self) -> None:
        super().__post_init__()
        expect_count("resolution", self.resolution, least=2)

    def measure(self, scene: Scene, pose: Pose, rng: np.random.Generator) -> Scan:
        """Every pixel's first hit."""
        view = see(scene, pose, focal_length(scene, self.distance, self.resolution), self.resolution)
        return Scan.of(pose, view.points, view.points, view.faces)
