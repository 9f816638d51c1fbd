"""Farthest point sampling (Gonzalez 1985; Eldar et al. 1997), in rounds of many points at once.

The greedy order takes one point at a time, each the farthest from all that are taken. A point is settled when all
that are still farther lie so far from it that neither can come any nearer to what is taken by the other: the greedy
order would take it with the same distance. All such points are taken together. The result is that of the greedy
order, in tens of rounds instead of one per point.
"""

from __future__ import annotations

import numpy as np

ONE_BY_ONE = 64  # so many are taken one at a time, until the rest fall apart into neighbourhoods
BAND = 0.8  # a round looks at the points whose distance is at least this share of the largest


def farthest_points(points: np.ndarray, count: int, taken: int = 0) -> np.ndarray:
    """Choose ``count`` points, each the farthest from the ones before it.

    Parameters
    ----------
    points : (n, 3) array
    count : int, from 1 to n
    taken : int
        So many of the first points are chosen from the start. Without any, the point nearest the centroid is.

    Returns
    -------
    (count,) int array
        Indices into ``points``, the first ``taken`` of them 0, 1, 2, ...; the others from the farthest to the nearest.
        Where distances are equal the smaller index goes first.
    """
    from scipy.spatial import cKDTree

    chosen = list(range(min(taken, count)))
    if not chosen:
        chosen = [int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmin())]
    distance = cKDTree(points[chosen]).query(points)[0]
    distance[chosen] = -1.0
    values = [np.inf] * len(chosen)
    while len(chosen) < min(ONE_BY_ONE, count):
        index = int(distance.argmax())
        values.append(distance[index])
        chosen.append(index)
        distance = np.minimum(distance, np.linalg.norm(points - points[index], axis=1))
        distance[index] = -1.0

    parts, part_values = [np.array(chosen)], [np.array(values)]
    total = len(chosen)
    while True:
        largest = float(distance.max())
        # Whatever is still to come has at most this value; larger ones have their final place.
        if total >= count and sum(int((v >= largest).sum()) for v in part_values) >= count or largest <= 0:
            break
        new = _locally_farthest(points, distance, largest)
        parts.append(new)
        part_values.append(distance[new])
        total += len(new)
        nearest = cKDTree(points[new]).query(points, distance_upper_bound=largest)[0]
        distance = np.minimum(distance, nearest)
        distance[new] = -1.0
    indices, ranks = np.concatenate(parts), np.concatenate(part_values)
    ranks[: min(taken, count)] = np.inf
    order = np.lexsort((indices, -ranks))[:count]
    # When all that is left coincides with what is taken, the rest is filled up in the order of the input.
    rest = np.flatnonzero(distance >= 0)[: count - len(order)]
    return np.concatenate([indices[order], rest])


def _locally_farthest(points: np.ndarray, distance: np.ndarray, largest: float) -> np.ndarray:
    """The points that lie within the ``distance`` of none that has a larger one; among equals, the first of them."""
    from scipy.spatial import cKDTree

    band = np.flatnonzero(distance >= BAND * largest)
    band = band[np.lexsort((band, -distance[band]))]  # from the farthest on
    pairs = cKDTree(points[band]).query_pairs(largest, output_type="ndarray")
    first, second = np.sort(pairs, axis=1).T
    gap = np.linalg.norm(points[band[first]] - points[band[second]], axis=1)
    beaten = np.zeros(len(band), dtype=bool)
    beaten[second[gap < distance[band[first]]]] = True
    return band[~beaten]
