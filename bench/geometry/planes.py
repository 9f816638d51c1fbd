"""Planes through the neighbourhoods of a point cloud, at one size of neighbourhood or at many."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .neighbours import processors

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

CHUNK = 2_000_000  # neighbours whose coordinates are in memory at once


class Planes(NamedTuple):
    """The planes of n points at s sizes of neighbourhoods, in single precision: there may be many."""

    sizes: np.ndarray
    """(s,) int array, points of a neighbourhood, the point itself included, increasing"""
    normals: np.ndarray
    """(n, s, 3) float32 array of unit length, of either sign"""
    variances: np.ndarray
    """(n, s, 3) float32 array: smallest variance first, which is that along the normal"""
    offsets: np.ndarray
    """(n, s) float32 array: from the plane to the point, along the normal"""
    neighbours: np.ndarray
    """(n, r) int32 array: the neighbours of the ranks that were asked for"""


def fit_planes(
    points: np.ndarray, tree: cKDTree, sizes: Sequence[int], ranks: np.ndarray, at: np.ndarray | None = None
) -> Planes:
    """Principal component analysis of the nearest neighbours of every point, at several sizes in one pass.

    Parameters
    ----------
    points : (n, 3) float64 array
        Sorted along a space-filling curve, or else the queries are slow.
    tree : of the same points
    sizes : increasing, at most n
    ranks : (r,) int array
        Which neighbours to keep: 0 is the point itself. All are below n.
    at : (m,) int array
        The points whose planes are wanted, in this order; without it all n.

    Returns
    -------
    Planes
    """
    centers = points if at is None else points[at]
    n, s = len(centers), len(sizes)
    most = max(sizes[-1], int(ranks[-1]) + 1)
    normals, variances = np.empty((n, s, 3), np.float32), np.empty((n, s, 3), np.float32)
    offsets, kept = np.empty((n, s), np.float32), np.empty((n, len(ranks)), np.int32)
    step = max(1, CHUNK // most)
    for part in (slice(begin, begin + step) for begin in range(0, n, step)):
        found = tree.query(centers[part], most, workers=processors())[1].reshape(-1, most)
        kept[part] = found[:, ranks]
        # Relative to the point itself: differences of large coordinates are exact, and sums of small numbers accurate.
        local = points[found] - centers[part, None]
        first, second, begin = 0.0, 0.0, 0
        for scale, size in enumerate(sizes):
            ring = local[:, begin:size]
            first, second, begin = first + ring.sum(axis=1), second + np.swapaxes(ring, 1, 2) @ ring, size
            mean = first / size
            values, axes = np.linalg.eigh(second / size - mean[:, :, None] * mean[:, None])
            normals[part, scale], variances[part, scale] = axes[:, :, 0], np.maximum(values, 0)
            offsets[part, scale] = -np.einsum("ni,ni->n", mean, axes[:, :, 0])
    return Planes(np.asarray(sizes), normals, variances, offsets, kept)
