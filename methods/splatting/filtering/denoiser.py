"""The common part of the denoisers by filtered images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from bench import PointCloud, Run
from bench.geometry.check import check_points

if TYPE_CHECKING:
    from .cycles import Filter


@dataclass(frozen=True)
class FilteredImages:
    """A denoiser that filters images of the cloud; a subclass defines :meth:`filter_image`."""

    cycles: int = 4  # each with other cameras (released: 8)
    views: int = 12  # images of a cycle
    pixels: int = 256  # along each side of an image
    span: float = 0.93  # width of the field of view; the cloud has the radius 1
    normal_steps: int = 19  # of a cycle
    point_steps: int = 5  # of a cycle (released: 1)
    normal_rate: float = 0.1  # of the descent, for each point (released: 2,000 for 20,000 points)
    largest: float = 0.01  # of a gradient, entry by entry
    momentum: float = 0.1
    recursive: bool = False  # filter images of the current cloud instead of the input
    width: float = 0.5  # standard deviation of a point's Gaussian, in spacings
    depth_limit: float = 0.025  # splats behind the front by more are hidden
    repulsion: float = 0.05  # weight of Eq. 3.17
    projection: float = 0.1  # weight of Eq. 3.18 (released: 0.05; for noise of 1 % 0.1)
    average: float = 0.1  # weight of the mean of the input points, along the normals (released: 0.01)
    repulsion_distance: float = 1.25  # spacings
    projection_distance: float = 3.0  # spacings
    regularisers: Literal["released", "thesis"] = "released"  # their form, where the two differ

    def __post_init__(self) -> None:
        for name in ("cycles", "views", "pixels"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        for name in ("normal_steps", "point_steps", "repulsion", "projection", "average", "momentum"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")
        for name in ("span", "normal_rate", "largest", "width", "depth_limit"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")

    def prepare(self) -> None:
        """Load the compiled loops, or compile them."""
        from bench.geometry.farthest import load_compiled as load_farthest

        from ..fitting.warm import load_compiled

        load_farthest()
        load_compiled()

    def filter_image(self, image: np.ndarray) -> np.ndarray:
        """A shaded image (h, w, 3), from 0 to 1, without its noise."""
        raise NotImplementedError

    def image_filter(self, run: Run) -> Filter:
        """The filter of this run; a method that must load data for it overrides this."""
        return self.filter_image

    def pictured(self, cloud: PointCloud) -> PointCloud:
        """The cloud whose images are filtered: the input, with other normals if necessary."""
        return cloud

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points, in the same order, with normals; normals are estimated if there are none."""
        from bench.geometry.normals import with_normals
        from bench.geometry.spacing import mean_spacing

        from ..regularisers.settings import Regularity
        from ..renderer.settings import Drawing
        from .cycles import Filtering, filtered

        check_points(cloud.points, type(self).__module__.rpartition(".")[2], at_least=10)
        oriented, spacing = with_normals(cloud), mean_spacing(cloud.points)
        regular = Regularity.of(self, spacing)
        settings = Filtering(**{name: getattr(self, name) for name in Filtering.__dataclass_fields__})
        drawing = Drawing(depth_limit=self.depth_limit)
        pictured, image_filter = self.pictured(oriented), self.image_filter(run)
        return filtered(oriented, pictured, spacing, image_filter, settings, drawing, regular, run)
