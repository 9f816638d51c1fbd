"""A field from images by iso-points, more of them where the images are not explained."""

from __future__ import annotations

from dataclasses import dataclass

from bench import register

from .images.guided import ByIsoPoints


@register("method", cite="Yifan et al. 2021", requires=("torch", "trimesh", "skimage", "scipy"))
@dataclass(frozen=True)
class IsoLoss(ByIsoPoints):
    """``iso_uniform``, with a fifth of the samples beside those iso-points with the highest loss (thesis 4.2.1).

    The loss of an iso-point is the mean difference of its colour from the images that see it.
    """

    importance = "loss"
