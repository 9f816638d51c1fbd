"""Flat Gaussians with opacity, fitted to images."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bench import BadInput, PointCloud, Run, Views, register

if TYPE_CHECKING:
    from trimesh import Trimesh

SPARE = 0.2  # of the available seconds, at most 20, are left for the mesh
LATER = {"since": "0.2"}  # parameters of `multiview`; cells of `fit_shape` keep their ids


@register("method", cite="Huang et al. 2024", requires=("scipy", "numba", "open3d"))
@dataclass(frozen=True)
class Surfels:
    """2-D Gaussian splatting: surfels with two scales and opacity descend on the images; their centres are the cloud.

    Drawn by exact ray-splat intersection and composited front to back. Each step uses one view: L1 of colours and
    mask, depth distortion and normal consistency, by Adam. Unlike in the publication, colours are diffuse shading of
    the normals under the known lights (as for ``dss``), so there are no spherical harmonics and no D-SSIM; surfels have
    one side; and their number is constant: instead of densification, pruning and resets of opacity, surfels that are
    transparent, unseen or (``carve``) outside a mask become halves of those with the largest gradients.

    For ``multiview`` it starts from oriented points on the visual hull: depths at which the rays of pixels enter it,
    normals of planes through neighbours, turned to the cameras. The fit is the same, and the mesh is that of the
    remaining surfels, by screened Poisson (Kazhdan and Hoppe 2013); the publication fuses rendered depths instead.
    """

    steps: int = 2000  # each with one view
    scale: float = 0.6  # initial standard deviations, in spacings of the cloud
    opacity: float = 0.7  # the initial one, below 0.99
    position_rate: float = 0.15  # of Adam, in spacings
    turn_rate: float = 0.02  # of Adam, in radians
    scale_rate: float = 0.01  # of Adam, for the logarithms of standard deviations
    opacity_rate: float = 0.03  # of Adam, for the logits of opacities
    rate_decay: float = 0.05  # factor of all rates from the first step to the last
    mask_weight: float = 1.0  # of the L1 between accumulated opacities and masks
    distortion: float = 0.3  # weight of squared differences of depths along a ray
    consistency: float = 0.05  # weight of normals of surfels against normals of depths (publication: 0.05)
    relocate_every: int = 100  # steps
    relocate_until: float = 0.7  # of the steps
    relocated: float = 0.2  # of all surfels, at most, each time
    transparent: float = 0.05  # less opaque ones are moved, and omitted from the result
    carve: float = 2.0  # as are those outside a mask by more pixels than this; 0: only by opacity, as published
    points: int = field(default=4000, metadata=LATER)  # for multiview: initial number of surfels
    trim: float = field(default=0.0, metadata=LATER)  # for multiview: share of the least supported vertices to remove

    def __post_init__(self) -> None:
        for name in ("steps", "relocate_every"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        for name in ("mask_weight", "distortion", "consistency", "carve"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")
        for name in ("scale", "position_rate", "turn_rate", "scale_rate", "opacity_rate", "rate_decay"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")
        for name in ("relocate_until", "relocated", "transparent"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name}: expected a number between 0 and 1, got {getattr(self, name)}")
        if self.points < 10:
            raise ValueError(f"points: expected at least 10, got {self.points}")
        if not 0 <= self.trim < 1:
            raise ValueError(f"trim: expected 0 or more and below 1, got {self.trim}")
        if not 1 / 255 < self.opacity < 0.99:
            raise ValueError(f"opacity: expected a number between 1/255 and 0.99, got {self.opacity}")

    def prepare(self) -> None:
        """Load the compiled loops, or compile them."""
        from bench.geometry import farthest

        from .gaussian_surfels.warm import load_compiled

        load_compiled()
        farthest.load_compiled()

    def multiview(self, views: Views, run: Run) -> Trimesh:
        """A mesh of the fitted surfels, closed unless it is trimmed."""
        from .gaussian_surfels.meshing import poisson_mesh
        from .projected.beginning import points_on_the_hull

        self._check_lights(views)
        start = points_on_the_hull(views, self.points, run)
        return poisson_mesh(self._fitted(views, start, run, min(SPARE * run.seconds, 20.0)), self.trim)

    def fit_shape(self, views: Views, cloud: PointCloud, run: Run) -> PointCloud:
        """At most as many points as the initial cloud, with normals."""
        self._check_lights(views)
        if cloud.normals is None:
            raise BadInput("the initial cloud has no normals; this method needs them")
        return self._fitted(views, cloud, run)

    def _fitted(self, views: Views, cloud: PointCloud, run: Run, spare: float = 0.0) -> PointCloud:
        from bench.geometry.spacing import mean_spacing

        from .gaussian_surfels.fitting import Scene, Schedule, fit
        from .gaussian_surfels.losses import Weighting
        from .gaussian_surfels.state import State

        assert cloud.normals is not None
        spacing = mean_spacing(cloud.points)
        weighting = Weighting(self.mask_weight, self.distortion, self.consistency)
        schedule = Schedule(**{name: getattr(self, name) for name in Schedule.__dataclass_fields__})
        state = State(cloud.points, cloud.normals, self.scale * spacing, self.opacity)
        return fit(Scene(views, weighting, run.threads), state, spacing, schedule, run, spare)

    @staticmethod
    def _check_lights(views: Views) -> None:
        if views.light_directions is None:
            raise BadInput("the views have no lights; this method matches diffuse shading under known lights")
