"""Patches: the nearest points of a seed, in their own frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

TOGETHER = 1 << 24  # distances from seeds to all points that are in memory at once: 128 MB

Cutting = Callable[[np.ndarray, np.ndarray, int], np.ndarray]


class Normalised(NamedTuple):
    """Patches with their centroid at 0 and their farthest point at distance 1."""

    points: np.ndarray
    """(h, n, 3) float64 array"""
    centres: np.ndarray
    """(h, 1, 3) float64 array"""
    radii: np.ndarray
    """(h, 1, 1) float64 array, above 0: 1 if all points of a patch coincide"""

    def restore(self, points: np.ndarray) -> np.ndarray:
        """Points (h, m, 3) from the patches' frames, in the frame of the cloud."""
        return points * self.radii + self.centres


def seed_count(points: int, size: int, overlap: float = 3.0) -> int:
    """The number of patches of ``size`` points that cover a cloud ``overlap`` times (Wang et al. 2019: H = 3 |P| / N).

    At least enough for the patches to have as many points in total as the cloud.
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
        Indices into ``points``, the seed first and the others from the nearest on.
    """
    from scipy.spatial import cKDTree

    patches = cKDTree(points).query(points[seeds], np.arange(1, size + 1))[1]
    # Among coincident points any may come first, and a seed with many copies may be left out.
    for row in np.flatnonzero(patches[:, 0] != seeds):
        patches[row, patches[row] == seeds[row]] = patches[row, 0]
        patches[row, 0] = seeds[row]
    return patches


def cut_along(points: np.ndarray, seeds: np.ndarray, size: int, neighbours: int = 10) -> np.ndarray:
    """As :func:`cut`, but nearest along the edges of a graph that joins each point to its nearest ones.

    So the other side of a thin part is far away, unless the spacing exceeds its thickness. If a seed reaches too
    few points within three radii of the Euclidean patch, those nearest in space fill up.

    Parameters
    ----------
    points : (m, 3) array, m >= size
    seeds : (h,) int array
    size : int
    neighbours : int
        Of a point, to which it is joined, besides the points whose neighbour it is.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    m, k = len(points), min(neighbours + 1, len(points))
    tree = cKDTree(points)
    lengths, index = tree.query(points, np.arange(1, k + 1))
    # In a sparse graph, length 0 would mean no edge.
    lengths = np.maximum(lengths, np.finfo(float).tiny).ravel()
    graph = csr_array((lengths, (np.repeat(np.arange(m), k), index.ravel())), shape=(m, m))
    patches = cut(points, seeds, size)
    reach = 3 * np.linalg.norm(points[patches[:, -1]] - points[seeds], axis=1)
    together = max(1, TOGETHER // m)
    for first in range(0, len(seeds), together):
        some = slice(first, first + together)
        away = dijkstra(graph, directed=False, indices=seeds[some], limit=max(reach[some].max(), 1e-300))
        for row, distance in zip(range(first, first + len(away)), away, strict=True):
            distance[seeds[row]] = -1.0
            near = np.flatnonzero(distance < np.inf)
            near = near[np.argsort(distance[near], kind="stable")][:size]
            if len(near) < size:
                others = patches[row][~np.isin(patches[row], near)]
                near = np.concatenate([near, others[: size - len(near)]])
            patches[row] = near
    return patches


def covering(
    points: np.ndarray, size: int, overlap: float = 3.0, used: int | None = None, cutting: Cutting = cut
) -> np.ndarray:
    """Patches around farthest points, and around others until each point is in one.

    Farthest points are as dense in sparse parts of a cloud as in dense ones, where small patches then leave gaps.

    Parameters
    ----------
    points : (m, 3) array
    size : int
        Points of a patch; all of them if the cloud has fewer.
    overlap : float
        How many patches a point is in, on average.
    used : int, optional
        Only this number of points of a patch count, those nearest its seed.
    cutting : function
        :func:`cut` or :func:`cut_along`.

    Returns
    -------
    (h, min(size, m)) int array
        Indices into ``points``, the seed first and the others from the nearest on.
    """
    from bench.geometry.farthest import farthest_points

    count = len(points)
    size = min(size, count)
    used = min(used or size, size)
    seeds = farthest_points(points, min(seed_count(count, size, overlap), count))
    patches = cutting(points, seeds, size)
    while True:
        bare = np.ones(count, dtype=bool)
        bare[patches[:, :used]] = False
        missing = np.flatnonzero(bare)
        if not len(missing):
            return patches
        seeds = missing[farthest_points(points[missing], -(-len(missing) // used))]
        patches = np.concatenate([patches, cutting(points, seeds, size)])


def centrality(patches: np.ndarray) -> np.ndarray:
    """The number of other patches in which each point of (h, n) patches is nearer the seed: (h, n) int array, best 0.

    Nearness is the column; of equal ones the first patch counts as better.
    """
    h, n = patches.shape
    flat = patches.ravel()
    order = np.lexsort((np.tile(np.arange(n), h), flat))
    begins = np.flatnonzero(np.diff(flat[order], prepend=-1))
    rank = np.empty(len(flat), dtype=np.int64)
    rank[order] = np.arange(len(flat)) - np.repeat(begins, np.diff(begins, append=len(flat)))
    return rank.reshape(h, n)


def most_central(dense: np.ndarray, rank: np.ndarray, central: int) -> np.ndarray:
    """The copies of each point from the ``central`` patches in which it is nearest the seed.

    Parameters
    ----------
    dense : (h, r n, 3) array
        First copies of the n points of each patch, then second ones, and so on.
    rank : (h, n) int array
        Of :func:`centrality`.
    central : int
        0 for all.

    Returns
    -------
    (k, 3) array
    """
    if central:
        h, n = rank.shape
        dense = dense.reshape(h, -1, n, 3).transpose(0, 2, 1, 3)[rank < central]
    return dense.reshape(-1, 3)


def normalise(patches: np.ndarray) -> Normalised:
    """Move each patch of (h, n, 3) to its centroid and scale its farthest point to distance 1."""
    centres = patches.mean(axis=1, keepdims=True)
    centred = patches - centres
    radii = np.sqrt((centred**2).sum(axis=2).max(axis=1))[:, None, None]
    # A patch of copies of one point has a radius of rounding errors: scaling would turn them into noise.
    scale = np.abs(patches).max(axis=(1, 2))[:, None, None]
    radii = np.where(radii > 1e-12 * scale, radii, 1.0)
    return Normalised(centred / radii, centres, radii)
