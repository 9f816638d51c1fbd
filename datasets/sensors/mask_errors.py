"""Masks with errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Effect, Shape, Views, register

from .checks import expect, expect_length
from .spoiling import seen_as


@register("sensor", gives="views")
@dataclass(frozen=True)
class MaskErrors(Effect[Views]):
    """Wavy borders of masks, holes in masks, and blobs beside them; images stay as they are.

    A border is moved outwards by ``amplitude`` times a smooth random field of mean 0 and deviation 1: Gaussian noise of
    the pixels, filtered by a Gaussian of ``smoothness`` pixels. A pixel is then in the mask where its signed distance
    from the border, positive inside, plus this shift is above 0. A hole is a disc around a random pixel of the mask, a
    blob is one around a random pixel outside.
    """

    amplitude: float = 2.0  # standard deviation of the shift of a border, in pixels
    smoothness: float = 8.0  # of the field, in pixels; the waves of a border are about three times as long
    holes: float = 0.0  # probability that a mask has a hole
    blobs: float = 0.0  # probability that there is a blob beside a mask
    radius: float = 6.0  # of holes and blobs, in pixels

    def __post_init__(self) -> None:
        expect_length("amplitude", self.amplitude)
        expect(1 <= self.smoothness < np.inf, "smoothness", "at least 1", self.smoothness)
        expect(0 <= self.holes <= 1, "holes", "0 to 1", self.holes)
        expect(0 <= self.blobs <= 1, "blobs", "0 to 1", self.blobs)
        expect_length("radius", self.radius)

    def spoil(self, views: Views, shape: Shape, rng: np.random.Generator) -> Views:
        """The views with other masks."""
        masks = views.masks.copy()
        wavering, punching = rng.spawn(2)
        for mask in masks:
            before = mask.copy()
            if self.amplitude:
                field = self.amplitude * smooth_field(mask.shape, self.smoothness, wavering)
                mask[...] = signed_distance(mask) + field > 0
            for chance, places, value in ((self.holes, before, False), (self.blobs, ~before, True)):
                if punching.random() < chance and places.any():
                    center = punching.choice(np.argwhere(places))
                    mask[_disc(mask.shape, center, self.radius)] = value
        return seen_as(views, masks=masks)


def smooth_field(shape: tuple[int, int], smoothness: float, rng: np.random.Generator) -> np.ndarray:
    """Gaussian noise filtered by a Gaussian of deviation ``smoothness``, of mean 0 and deviation 1; it is periodic.

    Filtered white noise has the deviation 1 / (2 sqrt(pi) smoothness): the root of the integral of the squared kernel.
    """
    from scipy.ndimage import gaussian_filter

    return 2 * np.sqrt(np.pi) * smoothness * gaussian_filter(rng.normal(size=shape), smoothness, mode="wrap")


def signed_distance(mask: np.ndarray) -> np.ndarray:
    """Distances (h, w) of the middles of pixels from the border of a mask, in pixels: positive inside.

    The border is half a pixel from the nearest pixel on the other side. Without any border, distances are infinite.
    """
    from scipy.ndimage import distance_transform_edt

    if mask.all() or not mask.any():
        return np.where(mask, np.inf, -np.inf)
    return np.where(mask, distance_transform_edt(mask) - 0.5, 0.5 - distance_transform_edt(~mask))


def _disc(shape: tuple[int, int], center: np.ndarray, radius: float) -> np.ndarray:
    """The pixels (h, w) whose middles are within ``radius`` of one."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    return (rows - center[0]) ** 2 + (columns - center[1]) ** 2 <= radius**2
