"""DSS: oriented points fitted to images by differentiable rendering."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bench import BadInput, PointCloud, Run, Views, register


@register("method", cite="Yifan et al. 2019", requires=("scipy", "numba", "torch"))
@dataclass(frozen=True)
class Dss:
    """Differentiable surface splatting (thesis 3.2): oriented points follow the differences between images.

    Cycles of two descents over some of the views: of the normals through the shading, then of the positions through
    changes of visibility (Eq. 3.12), with repulsion and projection. Lengths of the regularisers are in
    spacings of the initial points, so that they do not depend on the number of points.
    """

    cycles: int = 8  # each with other views
    normal_steps: int = 15  # of a cycle
    point_steps: int = 25  # of a cycle
    views: int = 6  # images of a cycle (thesis: 12)
    normal_rate: float = 0.25  # of the descent, for each point: for 8,003 points it is the released 2,000
    point_rate: float = 1.0  # of the descent (thesis: 5)
    largest: float = 0.01  # of a gradient, entry by entry; times the rate it is the largest step
    rate_decay: float = 0.75  # factor of both rates, and of projection, from cycle to cycle (released: 1)
    momentum: float = 0.1
    width: float = 0.8  # standard deviation of a point's Gaussian, in spacings of the initial cloud (released: 0.5)
    cutoff: float = 1.0  # C of Eq. 3.7
    depth_limit: float = 0.05  # T: splats behind the front by more are hidden
    layers: int = 5  # K: splats stored for a pixel
    gradient: Literal["dss", "rbf"] = "dss"  # of positions: by visibility, or by the Gaussians' derivative
    weights: bool = False  # also the derivative of the weights (thesis: in the equations; released code: not)
    window: float = 0.25  # pixels farther from a point than this have no effect, in widths of the image; 0: all have
    window_decay: float = 0.8  # factor of the window from cycle to cycle (released: 0.9)
    window_least: float = 0.0625  # widths of the image
    opening: float = 2.0  # pixels are grouped into blocks beyond this distance, in sizes of the block; 0: never
    repulsion: float = 0.03  # weight of Eq. 3.17 (thesis: 0.05)
    repulsion_distance: float = 1.25  # spacings
    projection: float = 0.05  # weight of Eq. 3.18 (thesis: 0.02)
    projection_distance: float = 2.5  # spacings (released: 7.5, of which 32 neighbours fill 3)
    project_every: int = 2  # steps
    silhouettes: float = 1.0  # share of the way to the silhouette that points outside of it move (thesis: 0)
    refinements: int = 0  # cycles on the parts where the images differ most (released fine-tuning: 15)
    refined_part: float = 0.35  # size of these parts, in widths of the images
    loss_epsilon: float = 1.0  # of Eq. 3.19 (thesis: 1e-5, released: 0.01)
    regularisers: Literal["released", "thesis"] = "released"  # their form, where the two differ

    def __post_init__(self) -> None:
        for name in ("cycles", "views", "project_every", "layers"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        at_least_0 = ("repulsion", "projection", "momentum", "opening", "window", "window_least", "refinements")
        for name in ("normal_steps", "point_steps", *at_least_0):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")
        positive = ("normal_rate", "point_rate", "largest", "width", "cutoff", "depth_limit", "window_decay")
        for name in (*positive, "rate_decay", "loss_epsilon"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")
        if not 0 <= self.silhouettes <= 1:
            raise ValueError(f"silhouettes: expected a number from 0 to 1, got {self.silhouettes}")
        if not 0 < self.refined_part <= 1:
            raise ValueError(f"refined_part: expected a number above 0 and at most 1, got {self.refined_part}")

    def prepare(self) -> None:
        """Load the compiled loops, or compile them."""
        from .fitting.warm import load_compiled

        load_compiled()

    def fit_shape(self, views: Views, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the initial cloud, with normals."""
        from bench.geometry.spacing import mean_spacing

        from .fitting.cycles import Schedule, fit
        from .fitting.views import Gallery
        from .regularisers.settings import Regularity
        from .renderer.settings import Drawing

        if views.light_directions is None:
            raise BadInput("the views have no lights; this method matches diffuse shading under known lights")
        if cloud.normals is None:
            raise BadInput("the initial cloud has no normals; this method needs them")
        spacing = mean_spacing(cloud.points)
        drawing = Drawing(
            cutoff=self.cutoff,
            depth_limit=self.depth_limit,
            layers=self.layers,
            gradient=self.gradient,
            weights=self.weights,
            opening=self.opening,
        )
        regular = Regularity.of(self, spacing)
        settings = {name: getattr(self, name) for name in Schedule.__dataclass_fields__}
        schedule = Schedule(**settings | {"normal_rate": self.normal_rate * len(cloud)})
        gallery = Gallery.of(views, drawing, run.threads, self.loss_epsilon, run.device)
        return fit(gallery, cloud, self.width * spacing, schedule, regular, run)
