"""Farthest point sampling (Gonzalez 1985; Eldar et al. 1997), exact, at a cost of about n log n."""

from __future__ import annotations

import numpy as np


def farthest_points(points: np.ndarray, count: int, taken: int = 0) -> np.ndarray:
    """Choose ``count`` points, each the farthest from the ones before it.

    Parameters
    ----------
    points : (n, 3) array
    count : int, from 1 to n
    taken : int
        The number of first points that are chosen from the start. Without any, the point nearest the centroid is.

    Returns
    -------
    (count,) int array
        Indices into ``points``, the first ``taken`` of them 0, 1, 2, ...; the others from the farthest to the nearest.
        Where distances are equal the smaller index goes first. When all that is left coincides with what is taken,
        the rest is filled up in the order of the input.
    """
    from .farthest_tree import greedy, morton_order

    points = np.asarray(points, dtype=np.float64)
    order = morton_order(points)
    first = np.arange(min(taken, count))
    if not len(first):
        first = ((points - points.mean(axis=0)) ** 2).sum(axis=1).argmin(keepdims=True)
    places = np.empty(len(points), dtype=np.int64)
    places[order] = np.arange(len(points))
    chosen = order[greedy(points[order], order, places[first], count)]
    if len(chosen) < count:
        left = np.ones(len(points), dtype=bool)
        left[chosen] = False
        chosen = np.concatenate([chosen, np.flatnonzero(left)[: count - len(chosen)]])
    return chosen


def load_compiled() -> None:
    """Load the compiled loops of :func:`farthest_points`, or compile them: so that no measured call has to."""
    farthest_points(np.eye(3), 2)
