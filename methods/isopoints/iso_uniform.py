"""A field from images by iso-points, evenly spread."""

from __future__ import annotations

from dataclasses import dataclass

from bench import register

from .images.guided import ByIsoPoints


@register("method", cite="Yifan et al. 2021", requires=("torch", "trimesh", "skimage", "scipy"))
@dataclass(frozen=True)
class IsoUniform(ByIsoPoints):
    """A sine network fitted to images at iso-points, evenly spread over its surface (thesis 4.2, figure 4.18 right).

    Iso-points that a view sees are samples of the surface if they lie in the mask, and should recede if they do not.
    On rays of the mask, between the first and the last nearby iso-point, the least value should be inside. Network,
    loss, number of samples and everything else are those of ``idr``.
    """

    importance = "uniform"
