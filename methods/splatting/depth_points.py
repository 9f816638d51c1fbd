"""The naive renderer of the comparison: points rendered by projection, as smoothed depths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Run, Views, register


@register("method", cite="Yifan et al. 2019, baseline", requires=("numba", "scipy"))
@dataclass(frozen=True)
class DepthPoints:
    """Points rendered by projection as smoothed depth values: the baseline of thesis figure 3.24, which should fail.

    From the thesis: pixel intensities are sums of smoothed depth values, after Insafutdinov and Dosovitskiy
    (2018) and Roveri et al. (2018); gradients are local to a point's pixels, and normals are not used. So here: a
    point adds its depth, times a Gaussian in the image, to the pixels around its projection where it is in front, and
    gets gradients only there: by its depth, and by the Gaussian. If the Gaussians of a pixel sum to more than 1, it is
    the mean instead, so that it does not depend on the density of the points. The thesis compares with depth images of
    the target. The views have none, so those of the visual hull of the masks are used: concave parts are filled.
    Colours are not used; the returned cloud has no normals.
    """

    steps: int = 300  # of the descent
    views: int = 6  # images of a step
    rate: float = 0.01  # of Adam; it falls to a tenth
    sigma: float = 2.0  # of a point's Gaussian, in pixels
    depth_limit: float = 0.1  # points behind the front of a pixel by more are hidden there
    cells: int = 96  # of the visual hull, along each axis

    def __post_init__(self) -> None:
        for name in ("steps", "views", "cells"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        for name in ("rate", "sigma", "depth_limit"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")

    def prepare(self) -> None:
        """Load the compiled loops, or compile them."""
        from .projected.depth_image import Blur, draw, draw_back

        place, one, blur = np.full((1, 2), 2.0), np.ones(1), Blur(1.0, 0.1)
        drawn = draw(place, one, one, (4, 4), blur)
        draw_back(place, one, one, blur, drawn, np.ones((4, 4)))

    def fit_shape(self, views: Views, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the initial cloud, without normals."""
        from .projected.depth_image import Blur
        from .projected.fitting import DepthImages, fit
        from .projected.hull import hull_depths

        blur = Blur(float(self.sigma), float(self.depth_limit))
        images = DepthImages(views, hull_depths(views, self.cells), blur)
        return fit(images, cloud.points, self.steps, self.views, self.rate, run)
