"""A balanced binary tree of points, and the nodes that count as one source for each leaf.

The points do not move while normals are computed, so this is done once. A node counts as one source for a leaf if
its radius is at most ``opening`` times the least distance that any point of the leaf can have to its centre.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

LEAF = 24  # points of a leaf, at most: short loops that a processor runs several steps at a time


@dataclass(frozen=True, eq=False)
class Tree:
    """Nodes of one level follow those of the level above: the children of node i are 2 i + 1 and 2 i + 2."""

    order: np.ndarray
    """(n,) int array: the points, leaf by leaf"""
    points: np.ndarray
    """(n, 3) float64 array: in that order"""
    levels: int
    """The number of times the points are halved; there are ``2 ** levels`` leaves"""

    @classmethod
    def over(cls, points: np.ndarray, leaf: int = LEAF) -> Tree:
        """The tree of points (n, 3): each node is split across its longest side into halves of equal numbers."""
        count, levels = len(points), 0
        while count > leaf << levels:
            levels += 1
        order = np.arange(count)
        for level in range(levels):
            for k in range(1 << level):
                first, middle, last = (count * j >> (level + 1) for j in (2 * k, 2 * k + 1, 2 * k + 2))
                part = order[first:last]
                some = points[part]
                axis = np.ptp(some, axis=0).argmax()
                order[first:last] = part[np.argpartition(some[:, axis], middle - first)]
        return cls(order, np.ascontiguousarray(points[order], dtype=np.float64), levels)

    @cached_property
    def starts(self) -> np.ndarray:
        """(leaves + 1,) int array: where the points of each leaf begin, and the end."""
        return len(self.points) * np.arange((1 << self.levels) + 1) >> self.levels

    def sums(self, values: np.ndarray) -> np.ndarray:
        """The sum of values (n, c) over the points of each node, the root first: (2 ** (levels + 1) - 1, c)."""
        rows = [np.add.reduceat(values, self.starts[:-1], axis=0)]
        for _ in range(self.levels):
            rows.append(rows[-1][::2] + rows[-1][1::2])
        return np.concatenate(rows[::-1])

    @cached_property
    def centers(self) -> np.ndarray:
        """The mean of the points of each node: (nodes, 3)."""
        return self.sums(self.points) / self.sums(np.ones((len(self.points), 1)))

    @cached_property
    def radii(self) -> np.ndarray:
        """The distance from each centre to the farthest point of the node: (nodes,)."""
        radii = []
        for level in range(self.levels + 1):
            first = (1 << level) - 1
            starts = len(self.points) * np.arange((1 << level) + 1) >> level
            centers = np.repeat(self.centers[first : 2 * first + 1], np.diff(starts), axis=0)
            distance = np.linalg.norm(self.points - centers, axis=1)
            radii.append(np.maximum.reduceat(distance, starts[:-1]))
        return np.concatenate(radii)

    def runs(self, opening: float) -> tuple[np.ndarray, np.ndarray]:
        """The sources of each leaf: runs in the list of the n points followed by all nodes.

        Parameters
        ----------
        opening : float
            The largest radius of a node that counts as one source, relative to its distance; 0 for none.

        Returns
        -------
        begins : (leaves + 1,) int64 array
            The index in ``runs`` of the first run of each leaf.
        runs : (r, 2) int32 array
            The first source of each run, and the one after its last.
        """
        leaves = 1 << self.levels
        begins = np.zeros(leaves + 1, dtype=np.int64)
        arguments = (self.centers, self.radii, self.starts, opening)
        _walk(*arguments, begins, np.empty((0, 2), np.int32))
        runs = np.empty((begins[-1], 2), np.int32)
        _walk(*arguments, begins, runs)
        return begins, runs


@njit(cache=True)
def _walk(centers, radii, starts, opening, begins, runs):
    """Count the runs of each leaf, or write them if there is room for them."""
    leaves = len(starts) - 1
    nodes, count = len(radii), starts[-1]
    stack = np.empty(nodes, np.int64)
    found = 0
    for leaf in range(leaves):
        own = nodes - leaves + leaf
        stack[0] = 0
        depth = 1
        while depth > 0:
            depth -= 1
            node = stack[depth]
            away = 0.0
            for axis in range(3):
                away += (centers[own, axis] - centers[node, axis]) ** 2
            taken = radii[node] < opening * (np.sqrt(away) - radii[own])
            if not taken and node < nodes - leaves:
                stack[depth] = 2 * node + 1
                stack[depth + 1] = 2 * node + 2
                depth += 2
                continue
            if len(runs):
                k = node - (nodes - leaves)
                runs[found, 0] = count + node if taken else starts[k]
                runs[found, 1] = count + node + 1 if taken else starts[k + 1]
            found += 1
        begins[leaf + 1] = found
