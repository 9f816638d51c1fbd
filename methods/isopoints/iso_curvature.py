"""A field from images by iso-points, denser where the surface is curved."""

from __future__ import annotations

from dataclasses import dataclass

from bench import register

from .images.guided import ByIsoPoints


@register("method", cite="Yifan et al. 2021", requires=("torch", "trimesh", "skimage", "scipy"))
@dataclass(frozen=True)
class IsoCurvature(ByIsoPoints):
    """``iso_uniform``, with a fifth of the samples beside those iso-points where the surface is curved (thesis 4.2.1).

    Curvature is the distance of an iso-point from the mean of its neighbours.
    """

    importance = "curvature"
