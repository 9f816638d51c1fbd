"""A field from images by volume rendering."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bench import Run, register

from ..learned.fitting.trained import at_least
from .images.method import FromImages

if TYPE_CHECKING:
    from ..learned.training.loop import Sampling
    from .images.field import ImageField
    from .images.scene import Scene


@register("method", cite="Wang et al. 2021", requires=("torch", "trimesh", "skimage", "scipy"))
@dataclass(frozen=True)
class Neus(FromImages):
    """A sine network fitted to images by volume rendering, with weights that are unbiased about its zero level (NeuS).

    The colour of a pixel is a sum over samples of its ray, by opacities that follow from the field and a learned
    sharpness. Rays are not traced; the whole ray learns from its pixel. Network, lights and time are those of ``idr``,
    with fewer rays, each of which has many samples. Unlike in the publication, colours are known shading if the lights
    are known, the network is the thesis's, and the background is given by the mask.
    """

    samples: int = 256  # rays of a step, through all its images
    mask: float = 0.1  # weight of the masks (published)
    coarse: int = 32  # even parts of a ray (published: 64)
    fine: int = 32  # parts that are added where the surface is (published: 64)

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, coarse=2, fine=2)

    def kind_of_field(self) -> Any:
        """A field with a sharpness."""
        from .images.volume import VolumeField

        return VolumeField

    def sampler(self, field: ImageField, scene: Scene, run: Run) -> Sampling:
        """Rays with samples."""
        from .images.volume import VolumeField, VolumeSampler

        assert isinstance(field, VolumeField)
        counts = (self.views, self.samples, self.coarse, self.fine)
        return VolumeSampler(field, lambda: float(field.sharpness()), scene, *counts, run.torch_generator())
