"""A stereo depth camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import register

from .checks import expect, expect_length, expect_positive
from .scanning import Scan, Scanner
from .scene import Scene, see
from .views import Pose


@register("sensor", requires=("open3d",), cite="Grunnet-Jepsen et al. (Intel) 2018")
@dataclass(frozen=True)
class Stereo(Scanner):
    """Two cameras side by side, as in the RealSense D400 series: noise and steps that grow with the square of depth.

    The disparity ``focal baseline / z`` gets Gaussian noise of ``subpixel`` pixels and is rounded to 1 / ``steps``
    pixel. To first order the depth then has the standard deviation ``z^2 subpixel / (focal baseline)`` of Intel's
    "Best-known-methods for tuning RealSense D400 depth cameras", with ``focal = width / (2 tan(field / 2))``. A point
    that the right camera does not see is lost. The device works in metres, so ``size`` gives the size of the object.
    """

    size: float = 0.4  # bounding-sphere radius of the object, in metres
    baseline: float = 0.05  # between the cameras, in metres
    width: int = 848  # pixels across the horizontal field of view; the image is cut to the object
    field: float = 86.0  # horizontal field of view, in degrees
    subpixel: float = 0.08  # standard deviation of the disparity, in pixels
    steps: int = 32  # of the disparity per pixel; 0 does not round
    max_angle: float = 80.0  # degrees between ray and normal above which pixels are not matched; below 90

    def __post_init__(self) -> None:
        super().__post_init__()
        expect(0.01 <= self.size <= 10, "size", "0.01 to 10 metres", self.size)
        expect_positive("baseline", self.baseline)
        expect(16 <= self.width <= 8192, "width", "16 to 8192 pixels", self.width)
        expect(10 <= self.field <= 150, "field", "10 to 150 degrees", self.field)
        expect_length("subpixel", self.subpixel)
        expect(self.steps >= 0, "steps", "0 or more", self.steps)
        expect(0 < self.max_angle < 90, "max_angle", "more than 0 and less than 90", self.max_angle)

    @property
    def focal(self) -> float:
        """The focal length in pixels."""
        return self.width / 2 / np.tan(np.radians(self.field) / 2)

    def measure(self, scene: Scene, pose: Pose, rng: np.random.Generator) -> Scan:
        """The pixels that both cameras see."""
        view = see(scene, pose, self.focal, int(np.ceil(2 * self.focal / np.sqrt(self.distance**2 - 1))))
        metre = scene.radius / self.size
        right = pose.center + self.baseline * metre * pose.axes[0]
        disparity = self.focal * self.baseline * metre / view.depth
        disparity = disparity + self.subpixel * rng.normal(size=len(disparity))
        if self.steps:
            disparity = np.round(self.steps * disparity) / self.steps
        kept = (view.cosine > np.cos(np.radians(self.max_angle))) & (disparity > 0)
        kept &= scene.sees(view.points, view.faces, right)
        points = view.unproject(self.focal * self.baseline * metre / disparity[kept], view.pixels[kept])
        return Scan.of(pose, points, view.points[kept], view.faces[kept])
