"""A field from images by ray tracing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Run, register

from .images.method import FromImages

if TYPE_CHECKING:
    from ..learned.training.loop import Sampling
    from .images.field import ImageField
    from .images.scene import Scene


@register("method", cite="Yariv et al. 2020", requires=("torch", "trimesh", "skimage", "scipy"))
@dataclass(frozen=True)
class Idr(FromImages):
    """A sine network fitted to images at points found by ray tracing: the baseline of the thesis's table 4.5.

    Rays through random pixels are traced against the current field. If they meet it within the mask, its normals
    should explain the colours; if they do not, it should come nearer; outside of the mask it should recede. The tracer,
    the loss and its weights are those of implicit differentiable rendering; network and lights are the thesis's if
    the lights are known; otherwise a small network predicts the colours.
    """

    def sampler(self, field: ImageField, scene: Scene, run: Run) -> Sampling:
        """Ray tracing."""
        from .images.by_rays import RaySampler

        return RaySampler(field.network, scene, self.views, self.samples, self.space, run.torch_generator())
