"""Points far from all others: stray returns of a scanner, a point that was never set.

A single one makes the bounding box, the octree or the local spacing of a method meaningless.
They are removed before the method, and put back unmoved if the output must have every point of the input.
"""

from __future__ import annotations

import numpy as np

from bench import PointCloud, Run
from bench.geometry.distinct import distinct_rows
from bench.geometry.neighbours import processors

NEIGHBOURS = 8  # the largest number of stray points that may lie together
LINK = 3.0  # neighbours are linked up to this many spacings of the denser one
REACH = 10.0  # a point is not far up to this many typical spacings, or the radius of the largest piece
CROWDED = 0.1  # a piece whose spacing is below this share of the distance to the others is a separate object
MOST = 0.1  # the largest share of stray points; more are a sparse part of the scene


def isolated(points: np.ndarray) -> np.ndarray:
    """Which points lie far from all others, alone or in small scattered groups.

    Neighbours are linked into pieces. A piece outside of the largest 85 % of the points is isolated if its
    distance to the others exceeds the radius of the largest piece and ten typical spacings, and it has fewer than
    nine points, or is scattered (its spacing is more than a tenth of that distance). Sparse regions beside dense ones,
    lines of a scanner and objects far apart fail one of these conditions.

    Parameters
    ----------
    points : (n, 3) array, finite

    Returns
    -------
    (n,) bool array
        At most a tenth of the distinct points; if there are more, none count as isolated.
    """
    from scipy.spatial import cKDTree

    distinct, inverse = distinct_rows(points)
    strays = np.zeros(len(distinct), dtype=bool)
    if len(distinct) < 4 * NEIGHBOURS:
        return strays[inverse]
    distances, neighbours = cKDTree(distinct).query(distinct, NEIGHBOURS + 1, workers=processors())
    spacing = distances[:, -1]
    reach = REACH * np.median(spacing)
    # A far point closer than that to its eighth neighbour is in a crowd, which is not isolated.
    if spacing.max() > reach:
        piece = _pieces(distances, neighbours, spacing)
        strays = _far_pieces(distinct, spacing, piece, reach)[piece]
        if strays.mean() > MOST:
            strays[:] = False
    return strays[inverse]


def without_isolated(cloud: PointCloud, method: str, run: Run) -> tuple[PointCloud, np.ndarray]:
    """The cloud without its isolated points, and which remain, an (n,) bool array; a note gives their number."""
    if not np.isfinite(cloud.points).all():
        return cloud, np.ones(len(cloud), dtype=bool)  # the caller refuses it with its own message
    kept = ~isolated(cloud.points)
    if kept.all():
        return cloud, kept
    count = int((~kept).sum())
    run.note(f"{method}: {count} isolated point{'s' * (count > 1)}, far from all others, left out")
    return cloud.subset(kept), kept


def put_back(cloud: PointCloud, kept: np.ndarray, points: np.ndarray, normals: np.ndarray | None = None) -> PointCloud:
    """The moved ``points`` (and normals) at their places in the cloud, and the isolated ones unchanged.

    Isolated points without a normal of their own get that of the nearest other point.
    """
    from scipy.spatial import cKDTree

    if kept.all():
        return PointCloud(points, normals)
    moved = np.array(cloud.points, dtype=np.float64)
    moved[kept] = points
    if normals is None:
        return PointCloud(moved)
    turned = np.empty_like(moved)
    turned[kept] = normals
    turned[~kept] = normals[cKDTree(points).query(moved[~kept])[1]]
    if cloud.normals is not None:
        own = cloud.normals[~kept]
        lengths = np.linalg.norm(own, axis=1, keepdims=True)
        good = np.isfinite(lengths) & (lengths > 0)
        turned[~kept] = np.where(good, own / np.where(good, lengths, 1), turned[~kept])
    return PointCloud(moved, turned)


def _pieces(distances: np.ndarray, neighbours: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """The piece of every point; neighbours are linked if not much farther apart than the denser one's spacing."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(spacing)
    near = distances <= LINK * np.minimum(spacing[:, None], spacing[neighbours])
    start, column = np.nonzero(near)
    graph = coo_array((np.ones(len(start), dtype=bool), (start, neighbours[start, column])), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def _far_pieces(points: np.ndarray, spacing: np.ndarray, piece: np.ndarray, reach: float) -> np.ndarray:
    """Which pieces are isolated, a bool array over their numbers."""
    from scipy.spatial import cKDTree

    sizes = np.bincount(piece)
    order = np.argsort(-sizes, kind="stable")
    bulk = np.zeros(len(sizes), dtype=bool)
    bulk[order[: 1 + np.searchsorted(np.cumsum(sizes[order]), 0.85 * len(points))]] = True
    largest = points[piece == order[0]]
    # The median, not the farthest: a single point linked by chance does not count.
    reach = max(reach, 1.5 * float(np.median(np.linalg.norm(largest - np.median(largest, axis=0), axis=1))))
    while not bulk.all():
        rest = np.flatnonzero(~bulk[piece])
        gap = np.full(len(sizes), np.inf)
        np.minimum.at(gap, piece[rest], cKDTree(points[bulk[piece]]).query(points[rest])[0])
        widest = np.zeros(len(sizes))
        np.maximum.at(widest, piece[rest], spacing[rest])
        crowd = (sizes > NEIGHBOURS) & (widest < CROWDED * gap)
        joins = ~bulk & ((gap <= reach) | crowd)
        if not joins.any():
            break
        bulk |= joins
    return ~bulk
