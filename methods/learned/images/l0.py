"""L0 smoothing of images (Xu et al. 2011): as few changes of colour as possible."""

from __future__ import annotations

import numpy as np


def l0_smoothed(
    image: np.ndarray, weight: float = 0.05, first: float = 0.1, growth: float = 2.0, last: float = 1e5
) -> np.ndarray:
    """The image close to the input whose gradients vanish at all but a few pixels.

    It minimises the sum of squared differences plus ``weight`` times the number of pixels at which the image changes,
    by half-quadratic splitting (Eq. 8 to 12 there): differences below weight / beta are set to zero, the image with
    these differences is found by a Fourier transform, and beta grows.

    Parameters
    ----------
    image : (h, w, c) array
        Continued periodically beyond its borders.
    weight : float
        lambda; larger is smoother.
    first, growth, last : float
        beta begins at ``first``, and is multiplied by ``growth`` until it exceeds ``last``.

    Returns
    -------
    (h, w, c) float64 array
    """
    from scipy import fft

    image = np.asarray(image, dtype=np.float64)
    height, width = image.shape[:2]
    along_rows = 2 - 2 * np.cos(2 * np.pi * np.arange(height) / height)
    along_columns = 2 - 2 * np.cos(2 * np.pi * np.arange(width // 2 + 1) / width)
    both = (along_rows[:, None] + along_columns)[..., None]  # |F(d_x)|^2 + |F(d_y)|^2
    given = fft.rfft2(image, axes=(0, 1))
    smooth, beta = image, first
    while beta < last:
        down = np.roll(smooth, -1, axis=0) - smooth
        right = np.roll(smooth, -1, axis=1) - smooth
        small = (down**2 + right**2).sum(axis=2) < weight / beta
        down[small] = right[small] = 0
        divergence = np.roll(down, 1, axis=0) - down + np.roll(right, 1, axis=1) - right
        found = (given + beta * fft.rfft2(divergence, axes=(0, 1))) / (1 + beta * both)
        smooth = fft.irfft2(found, s=(height, width), axes=(0, 1))
        beta *= growth
    return smooth
