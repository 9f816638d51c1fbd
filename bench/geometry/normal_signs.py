"""Consistent signs of normals: along a minimum spanning tree, in one pass over all pieces of a cloud."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Forest(NamedTuple):
    """A spanning tree of every connected piece of a graph."""

    parent: np.ndarray
    """(n,) int array: the node above each node; a root is its own parent"""
    piece: np.ndarray
    """(n,) int array: the number of the piece that each node belongs to"""


def orient_normals(points: np.ndarray, normals: np.ndarray, neighbours: np.ndarray) -> np.ndarray:
    """Give normals consistent signs along a minimum spanning tree of the neighbour graph.

    Hoppe et al. 1992 carry the sign of ``n_i . n_j`` along an edge; König and Gumhold 2009 first reflect ``n_i`` across
    the edge, which is right at creases and across thin sheets but sensitive to noise. The reflected sign is used, and
    edges on which the two disagree are dear, so that the tree avoids them. A connected piece is then turned so that
    the volume that it encloses, as far as its samples are uniform, is positive (an inner wall, as of a hollow ball,
    would need the other sign).

    Parameters
    ----------
    points : (n, 3) array
    normals : (n, 3) array of unit length
    neighbours : (n, k) int array, the graph's edges; a point that is its own neighbour adds none

    Returns
    -------
    (n, 3) float64 array
    """
    signs, piece = consistent_signs(points, normals, neighbours)
    normals = normals * signs[:, None]
    sizes = np.bincount(piece)
    centers = np.stack([np.bincount(piece, points[:, axis]) / sizes for axis in range(3)], axis=1)
    # Divergence theorem: 3 V = integral of p . n over the surface.
    volumes = np.bincount(piece, np.einsum("ni,ni->n", points - centers[piece], normals))
    return normals * np.where(volumes < 0, -1.0, 1.0)[piece, None]


def consistent_signs(points: np.ndarray, normals: np.ndarray, neighbours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signs that make normals consistent within each connected piece, relative to one of its points.

    Returns
    -------
    signs : (n,) float64 array of 1 and -1
    piece : (n,) int array, the number of each point's piece
    """
    i, j = _edges(neighbours)
    cost = np.empty(len(i), dtype=np.float32)
    for part in (slice(begin, begin + 500_000) for begin in range(0, len(i), 500_000)):
        across, direct = _carried(points, normals, i[part], j[part])
        doubt = np.minimum(np.abs(across), np.abs(direct))
        cost[part] = np.where(across * direct > 0, 1 - doubt, 1 + doubt)
    forest = _spanning_forest(len(points), i, j, cost)
    above, _ = _carried(points, normals, np.arange(len(points)), forest.parent)
    is_root = forest.parent == np.arange(len(points))
    return _multiplied_from_the_root(forest.parent, np.where((above < 0) & ~is_root, -1.0, 1.0)), forest.piece


def _edges(neighbours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The undirected edges (i, j) of a neighbour graph with i < j, each once, in the order of i and then of j."""
    n, rows = len(neighbours), np.arange(len(neighbours), dtype=np.int64)
    # One number for each edge: rows are a good deal slower to sort, and so is numpy's hashing of many that differ.
    keys = []
    for column in neighbours.T:
        other = np.flatnonzero(column != rows)
        end = column[other].astype(np.int64)
        keys.append(np.minimum(other, end) * n + np.maximum(other, end))
    edges = np.concatenate(keys)
    del keys
    edges.sort()
    edges = edges[np.append(True, edges[1:] != edges[:-1])] if len(edges) else edges
    i = edges // n
    return i.astype(np.int32), (edges - i * n).astype(np.int32)


def _carried(points: np.ndarray, normals: np.ndarray, i: np.ndarray, j: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The cosines between ``n_j`` and ``n_i``, reflected across the edge and as it is."""
    along = points[j] - points[i]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    mine, theirs = normals[i], normals[j]
    direct = np.einsum("ei,ei->e", mine, theirs)
    return direct - 2 * np.einsum("ei,ei->e", mine, along) * np.einsum("ei,ei->e", theirs, along), direct


def _spanning_forest(count: int, i: np.ndarray, j: np.ndarray, cost: np.ndarray) -> Forest:
    """The cheapest tree of every connected piece; the edges are in the order of i.

    A node above all, joined to one node of each piece, makes one tree of the forest: it is walked once, however many
    pieces there are.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

    # An edge that costs nothing would not be stored; the order of the others is not touched.
    starts = np.searchsorted(i, np.arange(count + 1)).astype(np.int32)
    graph = csr_array(((cost + 1e-6).astype(np.float64), j, starts), shape=(count, count))
    tree = minimum_spanning_tree(graph, overwrite=True)
    _, piece = connected_components(tree, directed=False)
    _, roots = np.unique(piece, return_index=True)
    tree = tree.tocoo()
    start, end = np.append(tree.row, np.full(len(roots), count)), np.append(tree.col, roots)
    joined = csr_array((np.ones(len(start)), (start, end)), shape=(count + 1, count + 1))
    _, parent = breadth_first_order(joined, count, directed=False)
    parent = parent[:count].astype(np.intp)
    return Forest(np.where(parent == count, np.arange(count), parent), piece)


def _multiplied_from_the_root(parent: np.ndarray, sign: np.ndarray) -> np.ndarray:
    """For each node the product of the signs on its way to the root, by doubling the length of the way."""
    above = parent
    while True:
        further = above[above]
        sign = sign * sign[above]
        if np.array_equal(further, above):
            return sign
        above = further
