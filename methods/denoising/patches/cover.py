"""Patches around farthest points that cover a cloud, and the patch in which a point is most central."""

from __future__ import annotations

import numpy as np


def covering(points: np.ndarray, size: int, overlap: float = 3.0) -> np.ndarray:
    """The ``size`` nearest points of seeds, until each point is in a patch.

    Parameters
    ----------
    points : (m, 3) array
    size : int
        Points of a patch; all of them if the cloud has fewer.
    overlap : float
        How many patches a point is in, on average, at least 1.

    Returns
    -------
    (h, min(size, m)) int array
        Indices into ``points``, the seed or a copy of it first and the others from the nearest on.
    """
    from scipy.spatial import cKDTree

    from bench.geometry.farthest import farthest_points

    count = len(points)
    size, tree = min(size, count), cKDTree(points)
    seeds = farthest_points(points, min(count, -(-round(overlap * count) // size)))
    patches = tree.query(points[seeds], np.arange(1, size + 1))[1]
    while True:
        bare = np.ones(count, dtype=bool)
        bare[patches] = False
        missing = np.flatnonzero(bare)
        if not len(missing):
            return patches
        # If many points coincide, a query may leave out the seed itself.
        seeds = missing[farthest_points(points[missing], -(-len(missing) // size))]
        more = tree.query(points[seeds], np.arange(1, size + 1))[1]
        lacking = ~(more == seeds[:, None]).any(axis=1)
        more[lacking, 0] = seeds[lacking]
        patches = np.concatenate([patches, more])


def most_central(patches: np.ndarray, count: int) -> np.ndarray:
    """The place at which each of ``count`` points is nearest the seed: (count,) indices into ``patches.ravel()``.

    Nearness is the column; of equal ones the first patch counts.
    """
    h, size = patches.shape
    order = np.lexsort((np.tile(np.arange(size), h), patches.ravel()))
    place = np.flatnonzero(np.diff(patches.ravel()[order], prepend=-1))
    assert len(place) == count
    return order[place]
