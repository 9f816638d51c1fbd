"""Only the points that are visible from some directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Effect, PointCloud, Shape, register
from bench.geometry.mesh_surface import MeshSurface

from .checks import expect, expect_count
from .scene import Scene
from .spoiling import kept

FAR = 1000.0  # in bounding-sphere radii: parallel enough, and precise enough in float32


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class ViewSubset(Effect):
    """Only the points that are visible from one of a few random directions are left, as if scans were missing.

    Directions are uniform in a range of elevations: a high lower bound hides the parts under overhangs, like scans
    from above. Visibility is that of the closest point of the mesh, by ray casting, so noise does not hide points.
    """

    views: int = 2  # number of directions
    lowest: float = -90.0  # lowest elevation of the directions above the horizon, in degrees
    highest: float = 90.0  # highest elevation

    def __post_init__(self) -> None:
        expect_count("views", self.views)
        expect(-90 <= self.lowest <= 90, "lowest", "-90 to 90", self.lowest)
        expect(self.lowest <= self.highest <= 90, "highest", f"lowest={self.lowest} to 90", self.highest)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """The visible points, in their order."""
        scene = Scene(shape.mesh)
        at = MeshSurface(shape.mesh).project(cloud.points)
        visible = np.zeros(len(cloud), dtype=bool)
        for direction in self.directions(rng):
            visible |= scene.sees(at.points, at.faces, at.points + FAR * scene.radius * direction)
        return kept(cloud, visible, shape, "view_subset")

    def directions(self, rng: np.random.Generator) -> np.ndarray:
        """Unit vectors, uniform by area in the range of elevations: a (views, 3) array."""
        low, high = np.sin(np.radians([self.lowest, self.highest]))
        z = np.clip(rng.uniform(low, high, size=self.views), -1, 1)
        around = rng.uniform(0, 2 * np.pi, size=self.views)
        ring = np.sqrt(1 - z**2)
        return np.stack([ring * np.cos(around), ring * np.sin(around), z], axis=1)
