"""Patches: the nearest points of a seed, in a frame of their own."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Normalised(NamedTuple):
    """Patches with their centroid at 0 and their farthest point at distance 1."""

    points: np.ndarray
    """(h, n, 3) float64 array"""
    centres: np.ndarray
    """(h, 1, 3) float64 array"""
    radii: np.ndarray
    """(h, 1, 1) float64 array, above 0: 1 where all points of a patch coincide"""

    def restore(self, points: np.ndarray) -> np.ndarray:
        """Points (h, m, 3) of the patches' frames, in the frame of the cloud."""
        return points * self.radii + self.centres


def seed_count(points: int, size: int, overlap: float = 3.0) -> int:
    """How many patches of ``size`` points cover a cloud ``overlap`` times (Wang et al. 2019: H = 3 |P| / N).

    At least so many that the patches have together as many points as the cloud.
    """
    return max(-(-points // size), int(points / size * overlap))


def cut(points: np.ndarray, seeds: np.ndarray, size: int) -> np.ndarray:
    """The ``size`` points nearest each seed.

    Parameters
    ----------
    points : (m, 3) array, m >= size
    seeds : (h,) int array
        Indices into ``points``.
    size : int

    Returns
    -------
    (h, size) int array
        Indices into ``points``, nearest first.
    """
    from scipy.spatial import cKDTree

    return cKDTree(points).query(points[seeds], np.arange(1, size + 1))[1]


def normalise(patches: np.ndarray) -> Normalised:
    """Move each patch of (h, n, 3) to its centroid and scale its farthest point to distance 1."""
    centres = patches.mean(axis=1, keepdims=True)
    centred = patches - centres
    radii = np.sqrt((centred**2).sum(axis=2).max(axis=1))[:, None, None]
    # A patch of one point many times has a radius of rounding errors: to scale it would make noise of them.
    scale = np.abs(patches).max(axis=(1, 2))[:, None, None]
    radii = np.where(radii > 1e-12 * scale, radii, 1.0)
    return Normalised(centred / radii, centres, radii)
