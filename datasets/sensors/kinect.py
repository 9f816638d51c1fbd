"""The first Kinect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import register

from .checks import expect, expect_positive
from .scanning import Scan, Scanner
from .scene import Scene, View, see
from .views import Pose

FOCAL = 585.0  # of the depth camera, in pixels
BASELINE = 0.075  # from camera to projector, in metres
STEPS = 8  # of the disparity per pixel
NEAR, FAR = 0.4, 3.0  # metres between which the noise was measured


def axial_sigma(depth: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Standard deviation in metres of a depth in metres, of a surface at an angle in radians to the camera.

    Nguyen, Izadi, Lovell 2012, "Modeling Kinect sensor noise for improved 3D reconstruction and tracking":
    ``0.0012 + 0.0019 (z - 0.4)^2``, and above 60 degrees ``+ 0.0001 / sqrt(z) * a^2 / (pi / 2 - a)^2``.
    """
    frontal = 0.0012 + 0.0019 * (depth - 0.4) ** 2
    tilted = 0.0001 / np.sqrt(depth) * angle**2 / (np.pi / 2 - angle) ** 2
    return frontal + np.where(angle > np.pi / 3, tilted, 0.0)


def lateral_sigma(angle: np.ndarray) -> np.ndarray:
    """Standard deviation in pixels across the ray, at an angle in radians: ``0.8 + 0.035 a / (pi / 2 - a)``."""
    return 0.8 + 0.035 * angle / (np.pi / 2 - angle)


@register("sensor", requires=("open3d",), cite="Nguyen, Izadi and Lovell 2012")
@dataclass(frozen=True)
class Kinect(Scanner):
    """Kinect v1: structured light with the axial and lateral noise that Nguyen et al. (2012) measured.

    The device works in metres, so ``size`` gives the size of the object; the image has the device's pixels (585 per
    unit of the tangent), as many as the object covers. A pixel is lost in the projector's shadow (7.5 cm beside the
    camera), outside 0.4 to 3 m and at grazing angles. The disparity, focal * 7.5 cm / z, is rounded to 1/8 pixel, which
    gives the device's steps in depth: 2.8 mm at 1 m. (The measured noise includes some of that rounding.)
    """

    size: float = 0.4  # bounding-sphere radius of the object, in metres
    max_angle: float = 80.0  # degrees between ray and normal above which pixels are lost; below 90
    quantised: bool = True  # whether disparities are rounded to 1/8 pixel

    def __post_init__(self) -> None:
        super().__post_init__()
        expect(0.01 <= self.size <= 3, "size", "0.01 to 3 metres", self.size)
        expect_positive("max_angle", self.max_angle)
        expect(self.max_angle < 90, "max_angle", "less than 90", self.max_angle)

    def measure(self, scene: Scene, pose: Pose, rng: np.random.Generator) -> Scan:
        """The pixels that have a depth."""
        width = int(np.ceil(2 * FOCAL / np.sqrt(self.distance**2 - 1)))
        view = see(scene, pose, FOCAL, width)
        metre = scene.radius / self.size
        projector = pose.center + BASELINE * metre * pose.axes[0]
        angle = np.arccos(view.cosine)
        kept = angle < np.radians(self.max_angle)
        kept &= scene.sees(view.points, view.faces, projector)
        pixels, depth = self._noisy(view, np.minimum(angle, np.radians(self.max_angle)), metre, rng)
        kept &= (depth >= NEAR) & (depth <= FAR)
        return Scan.of(pose, view.unproject(depth[kept] * metre, pixels[kept]), view.points[kept], view.faces[kept])

    def _noisy(
        self, view: View, angle: np.ndarray, metre: float, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """The pixels (n, 2) at which the points appear, and their depths in metres."""
        pixels = view.pixels + lateral_sigma(angle)[:, None] * rng.normal(size=view.pixels.shape)
        depth = view.depth / metre
        depth = depth + axial_sigma(depth, angle) * rng.normal(size=len(depth))
        if self.quantised:
            disparity = FOCAL * BASELINE / np.maximum(depth, 1e-3)
            depth = FOCAL * BASELINE / np.maximum(np.round(STEPS * disparity) / STEPS, 1e-9)
        return pixels, depth
