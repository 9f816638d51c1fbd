"""The loops of farthest point sampling, compiled: a tree of boxes that know their farthest points (Han et al. 2023).

Points lie in leaves along a Morton curve. A box whose farthest point is nearer to what is taken than the box is to a
new point cannot change by it, so each point that is taken looks at a few leaves alone.
"""

from __future__ import annotations

import numpy as np
from numba import njit

LEAF = 32  # points
BITS = 21  # of a coordinate in a Morton code


def morton_order(points: np.ndarray) -> np.ndarray:
    """The order of points (n, 3) along a Morton curve through their bounding cube: (n,) int array."""
    low = points.min(axis=0)
    extent = float((points.max(axis=0) - low).max()) or 1.0
    cells = np.minimum((points - low) / extent * (1 << BITS), (1 << BITS) - 1).astype(np.uint64)
    code = np.zeros(len(points), dtype=np.uint64)
    for axis in range(3):
        spread = cells[:, axis]
        for shift, mask in (  # two zeros between any two bits
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            spread = (spread | (spread << np.uint64(shift))) & np.uint64(mask)
        code |= spread << np.uint64(axis)
    return np.argsort(code, kind="stable")


@njit(cache=True)
def _best_of_leaf(
    leaf: int, node: int, squared: np.ndarray, names: np.ndarray, best: np.ndarray, where: np.ndarray
) -> None:
    """Of a leaf, the largest distance and its place; the smallest name among equals."""
    begin, end = leaf * LEAF, min((leaf + 1) * LEAF, len(squared))
    best[node], where[node] = -1.0, -1
    for k in range(begin, end):
        if squared[k] > best[node] or (squared[k] == best[node] and where[node] >= 0 and names[k] < names[where[node]]):
            best[node], where[node] = squared[k], k


@njit(cache=True)
def _best_of_children(node: int, names: np.ndarray, best: np.ndarray, where: np.ndarray) -> None:
    left, right = 2 * node, 2 * node + 1
    better = left
    if best[right] > best[left] or (
        best[right] == best[left] and where[right] >= 0 and names[where[right]] < names[where[left]]
    ):
        better = right
    best[node], where[node] = best[better], where[better]


@njit(cache=True)
def greedy(points: np.ndarray, names: np.ndarray, start: np.ndarray, count: int) -> np.ndarray:
    """Take points, each the farthest from those before it, until there are ``count`` or all others coincide with them.

    Parameters
    ----------
    points : (n, 3) float64 array
        Along a curve: what is near in the order is near in space.
    names : (n,) int array
        Of equally far points the one with the smallest name is taken.
    start : (k,) int array, k >= 1
        Places of the points that are taken first.
    count : int, >= k

    Returns
    -------
    taken : (m,) int array, m <= count
        Places.
    """
    n = len(points)
    leaves = (n + LEAF - 1) // LEAF
    width = 1
    while width < leaves:
        width *= 2
    low = np.full((2 * width, 3), np.inf)
    high = np.full((2 * width, 3), -np.inf)
    best = np.full(2 * width, -1.0)
    where = np.full(2 * width, -1)
    squared = np.full(n, np.inf)
    for k in range(n):
        node = width + k // LEAF
        for axis in range(3):
            low[node, axis] = min(low[node, axis], points[k, axis])
            high[node, axis] = max(high[node, axis], points[k, axis])
    for leaf in range(leaves):
        _best_of_leaf(leaf, width + leaf, squared, names, best, where)
    for node in range(width - 1, 0, -1):
        for axis in range(3):
            low[node, axis] = min(low[2 * node, axis], low[2 * node + 1, axis])
            high[node, axis] = max(high[2 * node, axis], high[2 * node + 1, axis])
        _best_of_children(node, names, best, where)

    taken = np.empty(count, dtype=np.int64)
    stack = np.empty(2 * width, dtype=np.int64)
    visited = np.empty(2 * width, dtype=np.int64)
    for number in range(count):
        if number < len(start):
            place = start[number]
        elif best[1] > 0:
            place = where[1]
        else:
            return taken[:number]
        taken[number] = place
        x, y, z = points[place]
        squared[place] = -1.0
        stack[0], depth, seen = 1, 1, 0
        while depth:
            depth -= 1
            node = stack[depth]
            away = 0.0
            for axis in range(3):
                coordinate = points[place, axis]
                gap = max(low[node, axis] - coordinate, coordinate - high[node, axis], 0.0)
                away += gap * gap
            if away >= best[node]:
                continue
            if node >= width:
                leaf = node - width
                for k in range(leaf * LEAF, min((leaf + 1) * LEAF, n)):
                    if squared[k] > 0:
                        dx, dy, dz = points[k, 0] - x, points[k, 1] - y, points[k, 2] - z
                        squared[k] = min(squared[k], dx * dx + dy * dy + dz * dz)
                _best_of_leaf(leaf, node, squared, names, best, where)
            else:
                visited[seen] = node
                seen += 1
                stack[depth], stack[depth + 1] = 2 * node, 2 * node + 1
                depth += 2
        for k in range(seen - 1, -1, -1):  # children before their parents
            _best_of_children(visited[k], names, best, where)
        # The point itself is no longer there, in whatever boxes.
        node = width + place // LEAF
        _best_of_leaf(node - width, node, squared, names, best, where)
        while node > 1:
            node //= 2
            _best_of_children(node, names, best, where)
    return taken
