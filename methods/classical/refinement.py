"""Upsampling by insertion: midpoints between neighbours, moved onto the surface, thinned by farthest points.

The common part of `midpoint_jet`, `apss` and `rimls`; they differ in the surface that points are moved onto.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench.geometry.farthest import farthest_points

GROWTH = 4  # factor by which a round increases the points at most; a triangulation has three edges per vertex
LINKS = 12  # neighbours between which midpoints are set; two rings, so that few gaps are left
REACH = 1.6  # links longer than this many typical links of their ends would bridge a gap


def refine(points: np.ndarray, count: int, project: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Grow a cloud to ``count`` points, evenly, in rounds.

    Parameters
    ----------
    points : (n, 3) array
        Of the surface; they all stay, and come first.
    count : int, >= n
    project : function
        Moves an (m, 3) array of points that are near the surface onto it.

    Returns
    -------
    (count, 3) float64 array
    """
    rounds = int(np.ceil(np.log(count / len(points)) / np.log(GROWTH) - 1e-9))
    growth = (count / len(points)) ** (1 / max(rounds, 1))
    start = len(points)
    for done in range(1, rounds + 1):
        target = count if done == rounds else round(start * growth**done)
        candidates = project(midpoints(points))
        pool = np.concatenate([points, candidates])
        if len(pool) < target:  # tiny clouds have few pairs; copies of points fill up
            pool = np.resize(pool, (target, 3))
        points = pool[farthest_points(pool, target, taken=len(points))]
    return points


def midpoints(points: np.ndarray) -> np.ndarray:
    """The midpoints between neighbours, an (m, 3) array; links across gaps are left out."""
    from scipy.spatial import cKDTree

    k = min(LINKS + 1, len(points))
    distance, neighbours = cKDTree(points).query(points, k)
    start, end = np.repeat(np.arange(len(points)), k), neighbours.ravel()
    typical = np.median(distance[:, 1:], axis=1)
    keep = (start != end) & (distance.ravel() <= REACH * np.minimum(typical[start], typical[end]))
    links = np.unique(np.sort(np.stack([start[keep], end[keep]], axis=1), axis=1), axis=0)
    return points[links].mean(axis=1)
