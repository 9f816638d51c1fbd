"""Smooth minima and maxima of functions with their gradients."""

from __future__ import annotations

import numpy as np

ValueAndGradient = tuple[np.ndarray, np.ndarray]


def smooth_min(
    a: np.ndarray, a_gradient: np.ndarray, b: np.ndarray, b_gradient: np.ndarray, width: float
) -> ValueAndGradient:
    """A twice differentiable minimum: that of a and b where they differ by ``width`` or more, elsewhere below it.

    The cubic of Quilez: ``min(a, b) - width / 6 (1 - |a - b| / width)^3``, at most ``width / 6`` below the minimum. Its
    gradient is a weighted mean of the two, so it is not steeper than they are.

    Parameters
    ----------
    a, b : (n,) arrays
    a_gradient, b_gradient : (n, 3) arrays
    width : float, positive

    Returns
    -------
    value : (n,) array
    gradient : (n, 3) array
    """
    difference = a - b
    part = np.maximum(1 - np.abs(difference) / width, 0)
    square = part * part
    value = np.minimum(a, b) - width / 6 * part * square
    weight_b = (0.5 + np.copysign(0.5 - 0.5 * square, difference))[:, None]
    return value, a_gradient + weight_b * (b_gradient - a_gradient)


def smooth_max(
    a: np.ndarray, a_gradient: np.ndarray, b: np.ndarray, b_gradient: np.ndarray, width: float
) -> ValueAndGradient:
    """A twice differentiable maximum, ``-smooth_min(-a, -b)``: at most ``width / 6`` above the maximum."""
    value, gradient = smooth_min(-a, -a_gradient, -b, -b_gradient, width)
    return -value, -gradient
