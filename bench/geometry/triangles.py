"""Distances between triangles and points, in closed form."""

from __future__ import annotations

import numpy as np

MOST_NEIGHBOURS = 256  # of a triangle's centre that are tried one after the other
BRUTE_FORCE = 20_000_000  # pairs that may be tried where they do not settle it
CHUNK = 500_000  # pairs at a time: what fits the processor's cache and any memory


def point_triangle_distance(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The distance of each point to its triangle.

    Parameters
    ----------
    points : (n, 3) array
    triangles : (n, 3, 3) array, corner positions; degenerate ones count as the segments or points that they are

    Returns
    -------
    (n,) float64 array
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    nearest = np.minimum(_to_segment(points, a, b), np.minimum(_to_segment(points, b, c), _to_segment(points, c, a)))
    normal = np.cross(b - a, c - a)
    squared = np.einsum("ni,ni->n", normal, normal)
    # Inside the prism over the triangle the distance is that to its plane; outside an edge is nearest.
    inside = squared > 0
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= np.einsum("ni,ni->n", np.cross(normal, end - start), points - start) >= 0
    height = np.abs(np.einsum("ni,ni->n", normal, points - a)) / np.sqrt(np.where(inside, squared, 1.0))
    return np.where(inside, height, nearest)


def _to_segment(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    along = b - a
    length = np.einsum("ni,ni->n", along, along)
    t = np.einsum("ni,ni->n", p - a, along) / np.where(length > 0, length, 1.0)
    return np.linalg.norm(p - a - np.clip(t, 0, 1)[:, None] * along, axis=1)


def triangles_to_points(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The distance of each triangle to the nearest of a set of points.

    A point that is nearest to a triangle of circumscribed radius r (about its centre) is no farther from the centre
    than the best distance found so far plus r, so the neighbours of the centre are tried in their order until that is
    passed. Exact, but for triangles that have more than 256 points within reach while there are too many of them to
    try all: for these it is an upper bound, over by less than 2 r.

    Parameters
    ----------
    triangles : (f, 3, 3) array, corner positions
    points : (n, 3) array, n >= 1

    Returns
    -------
    (f,) float64 array
    """
    from scipy.spatial import cKDTree

    points = np.unique(points, axis=0)
    centers = triangles.mean(axis=1)
    radii = np.linalg.norm(triangles - centers[:, None], axis=2).max(axis=1)
    tree = cKDTree(points)
    best = np.full(len(triangles), np.inf)
    open_, tried = np.arange(len(triangles)), 0
    while len(open_) and tried < min(MOST_NEIGHBOURS, len(points)):
        k = min(max(8, 2 * tried), len(points))
        settled = np.zeros(len(open_), dtype=bool)
        for part in np.array_split(np.arange(len(open_)), 1 + len(open_) * k // CHUNK):
            f = open_[part]
            reach, found = tree.query(centers[f], k=np.arange(tried + 1, k + 1))
            distance = point_triangle_distance(
                points[found].reshape(-1, 3), np.repeat(triangles[f], found.shape[1], axis=0)
            ).reshape(found.shape)
            best[f] = np.minimum(best[f], distance.min(axis=1))
            settled[part] = reach[:, -1] >= best[f] + radii[f]
        open_, tried = open_[~settled], k
    if tried < len(points) and len(open_) * len(points) <= BRUTE_FORCE:
        for f in open_:
            same = np.broadcast_to(triangles[f], (len(points), 3, 3))
            best[f] = point_triangle_distance(points, same).min()
    return best
