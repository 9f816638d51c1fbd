"""A rotating LiDAR."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import register

from .checks import expect, expect_count, expect_length
from .scanning import Scan, Scanner
from .scene import Scene
from .views import Pose


@register("sensor", requires=("open3d",), cite="BlenSor: Gschwandtner et al. 2011")
@dataclass(frozen=True)
class Lidar(Scanner):
    """A rotating LiDAR: sparse rings of points, noise along the ray, weak returns lost.

    Its head turns about the scanner's upright axis, in steps of ``azimuth_step``; its channels evenly divide the angle
    under which the bounding sphere appears. The intensity of a return is ``cos(angle) / r^2``, 1 at normal incidence
    in the middle of the shape; below ``full_intensity`` a return is lost with probability ``1 - intensity /
    full_intensity``. Beams are thin: they do not average over edges.
    """

    channels: int = 32  # number of rings
    azimuth_step: float = 0.2  # degrees between the shots of a channel
    noise: float = 0.01  # standard deviation of the range, relative to the bounding-sphere radius
    full_intensity: float = 0.3  # intensity from which on no return is lost; 0 loses none

    def __post_init__(self) -> None:
        super().__post_init__()
        expect_count("channels", self.channels)
        expect(0.005 <= self.azimuth_step <= 90, "azimuth_step", "0.005 to 90 degrees", self.azimuth_step)
        expect_length("noise", self.noise)
        expect_length("full_intensity", self.full_intensity)

    def measure(self, scene: Scene, pose: Pose, rng: np.random.Generator) -> Scan:
        """The returns."""
        hit, points, faces = scene.cast(pose.center, self._directions(rng) @ pose.axes)
        rays = points - pose.center
        distance = np.linalg.norm(rays, axis=1)
        cosine = np.abs(np.einsum("ni,ni->n", rays, scene.normals[faces])) / distance
        intensity = cosine * (self.distance * scene.radius / distance) ** 2
        kept = rng.random(len(hit)) * self.full_intensity < intensity
        measured = distance + self.noise * scene.radius * rng.normal(size=len(hit))
        points_measured = pose.center + rays * (measured / distance)[:, None]
        return Scan.of(pose, points_measured[kept], points[kept], faces[kept])

    def _directions(self, rng: np.random.Generator) -> np.ndarray:
        """Unit vectors (n, 3) right, down and forward, of the shots that may meet the bounding sphere."""
        extent = np.arcsin(1 / self.distance)
        up = extent * (2 * (np.arange(self.channels) + 0.5) / self.channels - 1)
        step = np.radians(self.azimuth_step)
        around = np.arange(-extent, extent + step, step) + step * rng.random()  # the head starts anywhere
        around, up = (angles.ravel() for angles in np.meshgrid(around, up))
        return np.stack([np.cos(up) * np.sin(around), -np.sin(up), np.cos(up) * np.cos(around)], axis=1)
