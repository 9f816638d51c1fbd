"""Fitting points to depths of the visual hull by gradient descent."""

from __future__ import annotations

import numpy as np

from bench import PointCloud, Run, Views

from ..gaussian_surfels.adam import Adam
from ..renderer.camera import Camera
from .depth_image import Blur, draw, draw_back


class DepthImages:
    """Depth images to match; their values fall from 1 at the nearest to 0 at the farthest possible depth.

    Parameters
    ----------
    views : Views
    depths : (v, h, w) array
        Of each pixel, infinite for the background.
    blur : Blur
    """

    def __init__(self, views: Views, depths: np.ndarray, blur: Blur):
        self.cameras = [Camera.of(views, number) for number in range(len(views))]
        self.blur = blur
        # The unit ball lies between the distance of the camera minus and plus 1.
        self.farthest = np.linalg.norm(views.centers, axis=1) + 1
        values = self.value(depths, self.farthest[:, None, None])
        self.wanted = np.where(np.isfinite(depths), values, 0.0)
        self.known = np.isfinite(depths) | ~views.masks  # in the mask but not in the hull, the depth is unknown

    @staticmethod
    def value(depth: np.ndarray, farthest: np.ndarray | float) -> np.ndarray:
        """The intensity of a depth."""
        return 0.5 * (farthest - depth)

    def look(self, points: np.ndarray, view: int) -> tuple[float, np.ndarray]:
        """The mean squared difference of one image, and its gradient by the points (n, 3)."""
        camera = self.cameras[view]
        fx, fy, skew, cx, cy = camera.lens()
        x, y, z = np.ascontiguousarray(camera.to_camera(points).T)  # the loops are compiled for contiguous arrays
        near = np.where(z > 1e-3, z, np.inf)  # placeholders for the others
        place = np.column_stack([(fx * x + skew * y) / near + cx, fy * y / near + cy])
        value = self.value(z, self.farthest[view])
        drawn = draw(place, z, value, (camera.width, camera.height), self.blur)
        difference = (drawn[0] - self.wanted[view]) * self.known[view]
        by_place, by_value = draw_back(place, z, value, self.blur, drawn, 2 * difference / difference.size)
        column, row = by_place.T
        by_x, by_y = column * fx / near, (column * skew + row * fy) / near
        by_z = -(column * (fx * x + skew * y) + row * fy * y) / near**2 - 0.5 * by_value
        return float((difference**2).mean()), np.column_stack([by_x, by_y, by_z]) @ camera.rotation


def fit(images: DepthImages, points: np.ndarray, steps: int, views: int, rate: float, run: Run) -> PointCloud:
    """The points after ``steps`` steps of Adam, whose rate falls to a tenth; each uses ``views`` views."""
    descent, points = Adam(points.shape), np.array(points)
    count = min(views, len(images.cameras))
    for step in range(steps):
        if not run.time_for_more():
            break
        gradient = np.zeros_like(points)
        for view in run.rng.permutation(len(images.cameras))[:count]:
            gradient += images.look(points, view)[1]
        points = points + descent.step(gradient, rate * 0.1 ** (step / steps))
        run.progress(step + 1, steps)
        if (step + 1) % 50 == 0:
            run.trace(PointCloud(points))
    return PointCloud(points)
