"""The base of the methods that sample a surface by iso-points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from bench import Run

from ...learned.fitting.trained import at_least
from .method import FromImages

if TYPE_CHECKING:
    from ...learned.training.loop import Sampling
    from .field import ImageField
    from .scene import Scene


@dataclass(frozen=True)
class ByIsoPoints(FromImages):
    """Fits a sine network to images at iso-points."""

    importance: ClassVar[str] = "uniform"

    points: int = 4000  # iso-points, at first (thesis)
    most_points: int = 20_000  # in the end: a fifth more each time (thesis)
    warm_up: int = 0  # steps by ray tracing, before the first iso-points (thesis: 500)
    refresh: int = 100  # steps between new iso-points
    surface: float = 0.65  # share of the samples on the surface
    share: float = 0.2  # of those, the share at salient points (released)
    inner: float = 0.1  # weight of samples on rays within masks that are inside already, and should stay inside
    lowest: int = 2  # random samples on a ray outside of a mask, besides those near iso-points; the least value counts
    rim: float = 0.5  # share of the rays, inside and outside of masks, that are near a rim; they count less
    fill: bool = True  # voids within the shape, which no view sees, should be inside

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, points=100, most_points=self.points, warm_up=0, refresh=1, inner=0, lowest=1)
        for name in ("surface", "share"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(f"{name}: expected a number between 0 and 1, got {getattr(self, name)}")
        if not 0 <= self.rim < 1:
            raise ValueError(f"rim: expected 0 to less than 1, got {self.rim}")

    def sampler(self, field: ImageField, scene: Scene, run: Run) -> Sampling:
        """Iso-points."""
        from .by_points import Plan, PointSampler

        plan = Plan(**{name: getattr(self, name) for name in Plan.__dataclass_fields__})
        return PointSampler(field, scene, self.views, self.samples, self.space, plan, run, run.torch_generator())
