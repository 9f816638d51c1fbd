"""The image loss of the thesis: symmetric mean absolute percentage error (Eq. 3.19)."""

from __future__ import annotations

import numpy as np


def smape(image: np.ndarray, wanted: np.ndarray, epsilon: float = 0.01) -> tuple[float, np.ndarray]:
    """The mean over pixels and channels of |a - b| / (|a| + |b| + epsilon), and its derivative by ``image``.

    Parameters
    ----------
    image, wanted : (h, w, c) arrays
    epsilon : float
        As released; the thesis has 1e-5.

    Returns
    -------
    float, (h, w, c) float64 array
    """
    difference, size = image - wanted, np.abs(image) + np.abs(wanted) + epsilon
    loss = np.abs(difference) / size
    slope = np.sign(difference) / size - np.sign(image) * loss / size
    return float(loss.mean()), slope / loss.size
