"""Denoising by images with sparse gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import register

from .filtering.denoiser import FilteredImages


@register("method", cite="Yifan et al. 2019; Xu et al. 2011", requires=("scipy", "numba", "torch"))
@dataclass(frozen=True)
class DssL0(FilteredImages):
    """Surface splatting with L0 smoothing: shaded images become piecewise constant, and the normals follow them."""

    smoothing: float = 0.05  # lambda: larger is smoother

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.smoothing > 0:
            raise ValueError(f"smoothing: expected a number above 0, got {self.smoothing}")

    def filter_image(self, image: np.ndarray) -> np.ndarray:
        """As few changes of colour as possible."""
        from ..learned.images.l0 import l0_smoothed

        return l0_smoothed(image, self.smoothing)
