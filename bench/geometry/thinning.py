"""Points of about one distance: clouds that are thinned one point after the other, and grids on triangles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

FIRST, MOST = 4096, 500_000  # points handled at once: few at first, while few remain
CHUNK = 2_000_000  # points of a grid that are made in one go


def thinned(points: np.ndarray, distance: float, rng: np.random.Generator) -> np.ndarray:
    """The points that remain when each point, in random order, removes all others within a distance of it.

    The same as the loop over all points that scripts of benchmarks have, in the same order, some hundred times as fast.
    The result depends on the set of points and on the generator, not on the order in which the points come.

    Parameters
    ----------
    points : (n, 3) array
    distance : float, > 0
        Points at just this distance are removed, too.
    rng : Generator
        Draws the order.

    Returns
    -------
    (k, 3) array
    """
    from scipy.spatial import cKDTree

    points = points[np.lexsort(points.T)]
    points = points[rng.permutation(len(points))]
    kept = np.empty((0, 3))
    start, size = 0, FIRST
    while start < len(points):
        candidates = points[start : start + size]
        if len(kept):
            reach = np.nextafter(distance, np.inf)  # the bound itself is not within it
            apart, _ = cKDTree(kept).query(candidates, distance_upper_bound=reach)
            candidates = candidates[~(apart <= distance)]
        kept = np.concatenate([kept, candidates[_first_come(candidates, distance)]])
        start, size = start + size, min(2 * size, MOST)
    return kept


def _first_come(points: np.ndarray, distance: float) -> np.ndarray:
    """(n,) bool array: which points stay when each that stays removes those within a distance that come after it.

    In rounds: a point stays as soon as no earlier one that may stay is near it.
    """
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(distance, output_type="ndarray")  # the earlier one first
    stays, open_still = np.zeros(len(points), dtype=bool), np.ones(len(points), dtype=bool)
    while len(pairs):
        later = np.zeros(len(points), dtype=bool)
        later[pairs[:, 1]] = True
        first = open_still & ~later
        stays |= first
        removed = np.zeros(len(points), dtype=bool)
        removed[pairs[first[pairs[:, 0]], 1]] = True
        open_still &= ~(first | removed)
        pairs = pairs[open_still[pairs].all(axis=1)]
    return stays | open_still


def grids_on(corners: np.ndarray, spacing: float) -> Iterator[np.ndarray]:
    """Points of a grid of about that spacing on each of triangles (f, 3, 3), some at a time: (n, 3) arrays.

    Triangles below the spacing have none.
    """
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length, other = np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)
    area = np.linalg.norm(np.cross(first, second), axis=1)
    sound = area > 0
    corners, first, second, length, other, area = (a[sound] for a in (corners, first, second, length, other, area))
    step = spacing * np.sqrt(length * other / area)
    rows, columns = np.floor(length / step).astype(np.int64), np.floor(other / step).astype(np.int64)
    counts = np.where((rows > 0) & (columns > 0), rows * columns, 0)
    ends = np.cumsum(counts)
    start = 0
    while start < len(counts):
        stop = max(int(np.searchsorted(ends, (ends[start - 1] if start else 0) + CHUNK, side="right")), start + 1)
        part = np.arange(start, stop)
        of = np.repeat(part, counts[part])
        place = np.arange(len(of)) - np.repeat(np.cumsum(counts[part]) - counts[part], counts[part])
        u = (place // columns[of] + 0.5) / rows[of]
        v = (place % columns[of] + 0.5) / columns[of]
        inner = u + v < 1
        of, u, v = of[inner], u[inner, None], v[inner, None]
        yield corners[of, 0] + u * first[of] + v * second[of]
        start = stop
