"""Filtering by images of superpixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import register

from .filtering.denoiser import FilteredImages


@register("method", cite="Yifan et al. 2019; Achanta et al. 2012", requires=("scipy", "numba", "torch", "skimage"))
@dataclass(frozen=True)
class DssSlic(FilteredImages):
    """Surface splatting with superpixels: shaded images get regions of one colour each, and the shape gets facets."""

    segments: int = 150  # approximate number of regions of an image
    compactness: float = 20.0  # larger makes them rounder

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.segments < 1:
            raise ValueError(f"segments: expected at least 1, got {self.segments}")
        if not self.compactness > 0:
            raise ValueError(f"compactness: expected a number above 0, got {self.compactness}")

    def filter_image(self, image: np.ndarray) -> np.ndarray:
        """Regions of one colour each."""
        from .filtering.superpixels import superpixels

        return superpixels(image, self.segments, self.compactness)
