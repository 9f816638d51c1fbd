"""Images of a ball, in closed form: for trials and tests."""

from __future__ import annotations

import numpy as np

from ..geometry.spiral import golden_spiral
from .views import Views


def views_of_a_ball(count: int, pixels: int) -> Views:
    """Images of the unit ball, shaded by three lights of red, green and blue, in closed form."""
    backward = golden_spiral(count)
    distance, focal = 3.0, 1.3 * pixels
    right = np.cross([0.0, 0, 1], backward)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    rotation = np.stack([right, np.cross(-backward, right), -backward], axis=1)
    extrinsics = np.concatenate([rotation, np.tile([[[0.0], [0], [distance]]], (count, 1, 1))], axis=2)
    intrinsics = np.array([[focal, 0, pixels / 2], [0, focal, pixels / 2], [0, 0, 1]])
    lights = np.stack([backward, right, -rotation[:, 1]], axis=1)
    colors, ambient = np.tile(0.9 * np.eye(3), (count, 1, 1)), np.full((count, 3), 0.1)
    blank = np.zeros((count, pixels, pixels), dtype=bool)
    empty = Views(np.zeros((*blank.shape, 3), np.uint8), blank, extrinsics, intrinsics, lights, colors, ambient)
    images, masks = np.zeros((*blank.shape, 3)), blank.copy()
    for view in range(count):
        origins, directions = empty.rays(view)
        along = -(origins * directions).sum(-1)
        inside = 1 - ((origins + along[..., None] * directions) ** 2).sum(-1)
        masks[view] = inside > 0
        hit = origins + (along - np.sqrt(np.maximum(inside, 0)))[..., None] * directions
        shade = ambient[view] + np.maximum(hit @ lights[view].T, 0) @ colors[view]
        images[view] = np.where(masks[view][..., None], np.clip(shade, 0, 1), 0)
    return Views.of(empty.arrays() | {"images": np.round(255 * images).astype(np.uint8), "masks": masks})
