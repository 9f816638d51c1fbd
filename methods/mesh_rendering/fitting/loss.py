"""The loss of an image: the same for all renderers."""

from __future__ import annotations

import numpy as np


def image_loss(image: np.ndarray, wanted: np.ndarray, silhouette: float) -> tuple[float, np.ndarray]:
    """The absolute difference of colours inside the mask, and the squared difference of coverages; and the derivative.

    Both are means over all pixels (and channels). Colours outside the mask do not count, because the shape has none
    there: the coverage penalises the mesh there, and colours must not turn its normals away from the light.

    Parameters
    ----------
    image, wanted : (h, w, 4) arrays
        Red, green, blue and coverage, 0 to 1. The coverage of ``wanted`` is the mask.
    silhouette : float
        Weight of the coverage.

    Returns
    -------
    loss : float
    slope : (h, w, 4) float64 array
        The derivative by ``image``.
    """
    pixels = image.shape[0] * image.shape[1]
    difference = image - wanted
    difference[..., :3] *= wanted[..., 3:]
    colors, covered = difference[..., :3], difference[..., 3]
    loss = np.abs(colors).sum() / (3 * pixels) + silhouette * (covered * covered).sum() / pixels
    slope = np.empty_like(difference)
    slope[..., :3] = np.sign(colors) * wanted[..., 3:] / (3 * pixels)
    slope[..., 3] = 2 * silhouette / pixels * covered
    return float(loss), slope
