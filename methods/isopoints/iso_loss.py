"""A field from images by iso-points, denser where the loss is high."""

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
