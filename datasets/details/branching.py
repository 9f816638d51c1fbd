"""Branching skeletons by space colonisation, with radii by Murray's law."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Skeleton(NamedTuple):
    """A rooted tree in space; node 0 is the root and every parent comes before its children."""

    points: np.ndarray  # (n, 3)
    parent: np.ndarray  # (n,) indices, -1 at the root
    radius: np.ndarray  # (n,)


def colonise(goals: np.ndarray, trunk: np.ndarray, step: float, kill: float) -> tuple[np.ndarray, np.ndarray]:
    """Grow a tree towards goals, by space colonisation (Runions et al. 2007).

    Every goal attracts the node that is nearest to it; an attracted node grows a child towards its goals. A goal within
    ``kill`` of a node is dropped.

    Parameters
    ----------
    goals : (m, 3) array
    trunk : (k, 3) array
        The initial nodes, each the child of the previous one.
    step : float
        The length of the segments.
    kill : float
        The distance at which a goal counts as reached.

    Returns
    -------
    points : (n, 3) array
    parent : (n,) int array
    """
    points, parent = list(trunk), list(range(-1, len(trunk) - 1))
    nearest, distance = np.zeros(len(goals), dtype=int), np.full(len(goals), np.inf)
    fresh = 0
    for _ in range(200):
        for node in range(fresh, len(points)):  # only new nodes can be nearer than the known nearest ones
            to_node = np.sqrt(((goals - points[node]) ** 2).sum(axis=1))
            nearer = to_node < distance
            nearest[nearer], distance[nearer] = node, to_node[nearer]
        kept = distance > kill
        goals, nearest, distance, fresh = goals[kept], nearest[kept], distance[kept], len(points)
        if not len(goals):
            break
        pull = (goals - np.array(points)[nearest]) / distance[:, None]
        for node in np.unique(nearest):
            direction = pull[nearest == node].sum(axis=0)
            length = np.sqrt((direction**2).sum())
            grown = points[node] + step * direction / length if length > 0.1 else None
            # Two goals that attract equally from both sides would create the same node again and again.
            if grown is not None and min(((np.array(points[-80:]) - grown) ** 2).sum(axis=1)) > (0.3 * step) ** 2:
                points.append(grown)
                parent.append(int(node))
        if len(points) == fresh:
            break
    return np.array(points), np.array(parent)


def murray_radii(parent: np.ndarray, tip: float, exponent: float) -> np.ndarray:
    """Radii (n,) with ``r^p = sum of r_i^p`` over the children of each node, and ``tip`` at the leaves.

    The exponent p is 3 for vessels (Murray 1926) and about 2 for trees (Leonardo's rule).
    """
    power = np.zeros(len(parent))
    for node in range(len(parent) - 1, -1, -1):
        if power[node] == 0:
            power[node] = tip**exponent
        if parent[node] >= 0:
            power[parent[node]] += power[node]
    return power ** (1 / exponent)


def separate(skeleton: Skeleton, clearance: float) -> Skeleton:
    """Remove the twigs that come near to a part of the tree that is far from them along the tree.

    Two nodes clash if they are closer than ``clearance`` times the sum of their radii, although the path between them
    along the tree is more than twice as long as that. The thinner of the two is removed, with everything that grows
    from it.
    """
    from scipy.spatial import cKDTree

    points, parent, radius = skeleton
    lengths = np.zeros(len(points))
    depth = np.zeros(len(points), dtype=int)
    for node in range(1, len(points)):
        lengths[node] = lengths[parent[node]] + np.sqrt(((points[node] - points[parent[node]]) ** 2).sum())
        depth[node] = depth[parent[node]] + 1
    pairs = cKDTree(points).query_pairs(2 * clearance * radius.max(), output_type="ndarray")
    pairs = pairs[np.lexsort(pairs.T)]
    apart = np.sqrt(((points[pairs[:, 0]] - points[pairs[:, 1]]) ** 2).sum(axis=1))
    limit = clearance * (radius[pairs[:, 0]] + radius[pairs[:, 1]])
    pairs, limit = pairs[apart < limit], limit[apart < limit]
    meeting = _common_ancestors(pairs, parent, depth)
    way = lengths[pairs[:, 0]] + lengths[pairs[:, 1]] - 2 * lengths[meeting]
    clash = pairs[way > 2 * limit]
    kept = np.ones(len(points), dtype=bool)
    kept[np.where(radius[clash[:, 0]] < radius[clash[:, 1]], clash[:, 0], clash[:, 1])] = False
    for node in range(1, len(points)):
        kept[node] &= kept[parent[node]]
    number = np.cumsum(kept) - 1
    return Skeleton(points[kept], np.where(parent[kept] < 0, -1, number[parent[kept]]), radius[kept])


def _common_ancestors(pairs: np.ndarray, parent: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """The lowest common ancestor of each pair (n, 2): an (n,) array."""
    a, b = pairs.T.copy()
    while (differ := a != b).any():
        climb_a, climb_b = differ & (depth[a] >= depth[b]), differ & (depth[b] >= depth[a])
        a, b = np.where(climb_a, parent[a], a), np.where(climb_b, parent[b], b)
    return a
