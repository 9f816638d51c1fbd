"""MyPlugin: say in a line what the sensor does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Shape, register


@register("sensor")
@dataclass(frozen=True)
class MyPlugin:
    """Uniform samples with Gaussian noise along the normal (replace this by your sensor)."""

    count: int = 5000  # how many points
    noise: float = 0.005  # standard deviation, relative to the radius of the bounding sphere

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """A cloud of the shape, which is in the frame of the case; all random numbers come from `rng`."""
        # The frame: the centre of the shape's bounding box is at the origin, its farthest vertex at radius 1.
        points, normals = shape.surface.sample(self.count, rng)
        return PointCloud(points + self.noise * rng.normal(size=(self.count, 1)) * normals, normals)
