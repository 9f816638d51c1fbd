"""Noisy images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Effect, Shape, Views, register

from .checks import expect_length
from .spoiling import seen_as


@register("sensor", gives="views")
@dataclass(frozen=True)
class PixelNoise(Effect[Views]):
    """Independent Gaussian noise in every channel of every pixel, including the background.

    ``v -> round(clip(v + 255 sigma N(0, 1), 0, 255))`` for values v of 0 to 255. Masks stay as they are.
    """

    sigma: float = 0.02  # standard deviation, relative to full scale

    def __post_init__(self) -> None:
        expect_length("sigma", self.sigma)

    def spoil(self, views: Views, shape: Shape, rng: np.random.Generator) -> Views:
        """The views with noisy images."""
        images = np.empty_like(views.images)
        for noisy, image in zip(images, views.images, strict=True):  # one at a time: noise takes eight bytes a value
            noisy[...] = np.rint(np.clip(image + 255 * self.sigma * rng.normal(size=image.shape), 0, 255))
        return seen_as(views, images=images)
