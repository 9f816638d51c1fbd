"""Nearest neighbours between point sets, exact, in float64.

The kd-tree is pykdtree's, the fastest of those that were measured. The time of 100,000 queries does not depend on the
tree, though, but on the cache: points in random order visit the tree's memory at random. Sorted along a space-filling
curve they are answered in less than half the time, in every tree that was tried, so points are kept in an
:class:`OrderedPoints` that does the sorting once, and answers come back in the caller's order.
"""

from __future__ import annotations

import os
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from pykdtree.kdtree import KDTree

_CELLS = 32  # per axis: 15 bits of curve position, which numpy sorts by radix in a few milliseconds
# The five bits of a cell index, spread to every third bit.
_SPREAD = np.array([sum(((cell >> bit) & 1) << 3 * bit for bit in range(5)) for cell in range(_CELLS)], np.uint16)


class Nearest(NamedTuple):
    """The nearest neighbour of each of n points."""

    distance: np.ndarray
    """(n,) float64 array, Euclidean"""
    index: np.ndarray  # type: ignore[assignment]  # hides tuple.index, which nobody calls here
    """(n,) int array into the other set"""


def processors() -> int:
    """The number of processors that this process may use: a call of a method is pinned to its own."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


def curve_order(points: np.ndarray) -> np.ndarray:
    """Indices that sort points along a Z-order (Morton) curve through a coarse grid.

    Parameters
    ----------
    points : (n, 3) array

    Returns
    -------
    (n,) int array
        A permutation, the same on every machine. Outliers share the outermost cells: only speed depends on it.
    """
    if not len(points):
        return np.empty(0, dtype=np.intp)
    some = points[:: max(1, len(points) // 1000)]
    low, high = np.quantile(some, [0.01, 0.99], axis=0)
    width = float((high - low).max()) * 1.1 or 1.0
    with np.errstate(over="ignore"):  # whatever is beyond the grid is clipped into it
        cells = (points - (low + high - width) / 2) * (_CELLS / width)
    x, y, z = _SPREAD[np.clip(cells, 0, _CELLS - 1, out=cells).astype(np.uint8)].T
    return np.argsort(x | (y << 1) | (z << 2), kind="stable")


class OrderedPoints:
    """Points together with themselves in a cache-friendly order, and a kd-tree over them, built on first use.

    Parameters
    ----------
    points : (n, 3) float64 array, n >= 1
    """

    def __init__(self, points: np.ndarray):
        self.points = points

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def order(self) -> np.ndarray:
        """(n,) int array: the permutation that sorts the points along a space-filling curve."""
        return curve_order(self.points)

    @cached_property
    def along_curve(self) -> np.ndarray:
        """(n, 3) float64 array: ``points[order]``, contiguous."""
        return np.ascontiguousarray(self.points[self.order], dtype=np.float64)

    def restore(self, values: np.ndarray) -> np.ndarray:
        """Values computed for :attr:`along_curve`, in the order of :attr:`points`."""
        restored = np.empty_like(values)
        restored[self.order] = values
        return restored

    def nearest_in(self, others: OrderedPoints) -> Nearest:
        """The nearest of ``others`` to each of these points, exact, any one of them in case of ties."""
        tree, members = others._tree
        distance, found = tree.query(self.along_curve)
        return Nearest(self.restore(distance), self.restore(members[found]))

    @cached_property
    def _tree(self) -> tuple[KDTree, np.ndarray]:
        """The tree, and the index in :attr:`points` of each of its members."""
        from pykdtree.kdtree import KDTree

        points, members = self.along_curve, self.order
        # Equal points cannot be split among leaves: a query that meets k of them in one leaf looks at all k. A method
        # that lets its points collapse would keep the bench busy for minutes, so copies are left out of the tree.
        copies = (points[1:] == points[:-1]).all(axis=1).mean() if len(points) > 1 else 0.0
        if copies > 0.01:
            points, first = np.unique(points, axis=0, return_index=True)
            members = members[first]
        return KDTree(points), members
