"""Outliers in front of and behind the surface, as seen from viewpoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Effect, PointCloud, Shape, register

from ..common.rotations import random_rotation
from .checks import expect, expect_count, expect_fraction, expect_length
from .spoiling import replaced, some_of
from .views import fibonacci_sphere


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class OutliersRay(Effect):
    """Moves a share of the points along viewing rays: gross errors of the range, from virtual viewpoints.

    The viewpoints are spread over a sphere, turned at random; the viewpoint of a point is the one that its surface
    faces most directly, ignoring occlusion. Its displacement is uniform between -reach and reach; its normal stays.
    """

    fraction: float = 0.1  # of the points that become outliers; below 1
    reach: float = 0.5  # longest displacement, relative to the bounding-sphere radius
    views: int = 6  # viewpoints around the shape
    distance: float = 3.0  # of the viewpoints from the origin of the frame, in bounding-sphere radii

    def __post_init__(self) -> None:
        expect_fraction("fraction", self.fraction)
        expect_length("reach", self.reach)
        expect_count("views", self.views)
        expect(1 < self.distance < np.inf, "distance", "more than 1", self.distance)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """As many points as before."""
        lost = some_of(cloud, self.fraction, rng)
        if not len(lost):
            return cloud
        viewpoints = self.distance * fibonacci_sphere(self.views) @ random_rotation(rng).T
        points = cloud.points[lost]
        _, normals = shape.surface.closest(points)
        rays = points[:, None] - viewpoints
        rays /= np.linalg.norm(rays, axis=2, keepdims=True)
        facing = np.einsum("nvi,ni->nv", rays, normals).argmin(axis=1)
        ray = rays[np.arange(len(lost)), facing]
        errors = rng.uniform(-self.reach, self.reach, size=(len(lost), 1))
        return replaced(cloud, lost, points + errors * ray, rng, turn=False)
