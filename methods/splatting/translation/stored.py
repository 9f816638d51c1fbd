"""Shaded images as integers of eight bits; 0 is the background."""

from __future__ import annotations

import numpy as np

LIGHTEST = 1.275  # the value of 255; the lights and the ambient light together give 1.2


def stored(image: np.ndarray) -> np.ndarray:
    """An image as uint8, in steps of 0.005; pixels that have a colour stay above 0."""
    image = np.asarray(image)
    bytes_ = np.clip(np.round(image * (255 / LIGHTEST)), 0, 255)
    return np.where((image > 0).any(axis=-1, keepdims=True), np.maximum(bytes_, 1), 0).astype(np.uint8)
