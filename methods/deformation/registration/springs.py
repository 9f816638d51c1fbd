"""Weak springs that hold the separate parts of a mesh together."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

TIES = 8  # springs of a part that is not near to any other


def parts_of(edges: np.ndarray, count: int) -> np.ndarray:
    """(count,) int array: the connected component of each of ``count`` vertices, by edges (e, 2)."""
    ones = np.ones(len(edges))
    return connected_components(coo_array((ones, tuple(edges.T)), shape=(count, count)), directed=False)[1]


def springs_between(vertices: np.ndarray, parts: np.ndarray, reach: float) -> np.ndarray:
    """Pairs of nearby vertices of different parts: an (s, 2) int array.

    Each part is thinned to one vertex in a cell of half the reach, so that the number of springs of a joint depends on
    its size and not on the resolution of the mesh. Parts that are not joined to the largest piece, even through
    others, are tied to it by the nearest of their vertices: with the springs, the mesh is connected.

    Parameters
    ----------
    vertices : (n, 3) array
    parts : (n,) int array
        See :func:`parts_of`.
    reach : float
        The longest spring, in the unit of the vertices.
    """
    if not len(parts) or parts.max() == 0:
        return np.empty((0, 2), dtype=np.int64)
    cells = np.column_stack([parts, np.floor(vertices / (reach / 2)).astype(np.int64)])
    thinned = np.unique(cells, axis=0, return_index=True)[1]
    pairs = thinned[cKDTree(vertices[thinned]).query_pairs(reach, output_type="ndarray")]
    pairs = np.sort(pairs[parts[pairs[:, 0]] != parts[pairs[:, 1]]], axis=1)
    pairs = pairs[np.lexsort(pairs.T[::-1])]  # the tree does not guarantee an order
    pieces = parts_of(parts[pairs], int(parts.max()) + 1)[parts]
    return np.concatenate([pairs, *_ties(vertices, pieces)])


def _ties(vertices: np.ndarray, pieces: np.ndarray) -> list[np.ndarray]:
    """Springs from every piece but the largest to the largest."""
    largest = int(np.bincount(pieces).argmax())
    home = np.flatnonzero(pieces == largest)
    others = np.flatnonzero(pieces != largest)
    if not len(others):
        return []
    distance, nearest = cKDTree(vertices[home]).query(vertices[others])
    order = np.lexsort([distance, pieces[others]])  # by piece, the nearest first
    rank = np.arange(len(order)) - np.searchsorted(pieces[others][order], pieces[others][order])
    chosen = order[rank < TIES]
    return [np.column_stack([others[chosen], home[nearest[chosen]]])]
