"""Frames of patches: their principal axes, so that networks need not learn invariance to rotations."""

from __future__ import annotations

import numpy as np


def principal_frames(patches: np.ndarray) -> np.ndarray:
    """Rotations into the principal axes of patches, the narrowest last.

    Parameters
    ----------
    patches : (h, n, 3) array
        Rows at 0, which pad smaller patches, are ignored.

    Returns
    -------
    (h, 3, 3) array
        Rows are the axes: ``points @ frame.T`` are the points in the frame.
    """
    there = (patches != 0).any(axis=2, keepdims=True)
    count = np.maximum(there.sum(axis=1, keepdims=True), 1)
    centred = np.where(there, patches - patches.sum(axis=1, keepdims=True) / count, 0.0)
    covariance = np.einsum("hni,hnj->hij", centred, centred, dtype=np.float64)
    axes = np.linalg.eigh(covariance)[1].transpose(0, 2, 1)[:, ::-1]
    return axes * np.where(np.linalg.det(axes) < 0, -1.0, 1.0)[:, None, None]


def random_turns(count: int, rng: np.random.Generator) -> np.ndarray:
    """Rotations (count, 3, 3) that fix the last axis up to its sign: the ambiguity of frames."""
    angle, side = rng.uniform(0, 2 * np.pi, count), rng.choice([-1.0, 1.0], count)
    cosine, sine, zero = np.cos(angle), np.sin(angle), np.zeros(count)
    # If the axis changes its sign, one within the plane does so too.
    rows = [[cosine, -sine * side, zero], [sine, cosine * side, zero], [zero, zero, side]]
    return np.array(rows).transpose(2, 0, 1)
