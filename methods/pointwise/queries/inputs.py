"""The input of the network for a query: points near it, and a subsample of all."""

from __future__ import annotations

import numpy as np

FALLS_TO = 0.05  # probability of the farthest point, relative to that of a point at the query


def patches_of(points: np.ndarray, nearest: np.ndarray, queries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points near queries, relative to them and in units of the farthest.

    Parameters
    ----------
    points : (n, 3) array
    nearest : (b, k) int array
        The points near each query.
    queries : (b, 3) array

    Returns
    -------
    patches : (b, k, 3) float32 array, within the unit ball
    radii : (b,) float64 array
    """
    relative = points[nearest] - queries[:, None]
    radii = np.maximum(np.linalg.norm(relative, axis=2).max(axis=1), 1e-12)
    return (relative / radii[:, None, None]).astype(np.float32), radii


def wholes_of(
    points: np.ndarray, queries: np.ndarray, count: int, near: bool, unit: float, rng: np.random.Generator
) -> np.ndarray:
    """Some of all points, relative to queries: (b, count, 3) float32, in ``unit``.

    Parameters
    ----------
    points : (n, 3) array
    queries : (b, 3) array
    count : int
        Their number; with repetitions if there are fewer.
    near : bool
        Whether each query has its own points, nearer ones with a higher probability (as first published), which falls
        linearly to that of the farthest. Otherwise all are equally likely, and the queries share them.
    unit : float
    rng : numpy Generator
    """
    if not near:
        some = points[rng.choice(len(points), count, replace=len(points) < count)]
        return ((some - queries[:, None]) / unit).astype(np.float32)
    distance = np.linalg.norm(points - queries[:, None], axis=2)
    chance = 1 - (1 - FALLS_TO) * distance / np.maximum(distance.max(axis=1, keepdims=True), 1e-12)
    taken = min(count, len(points))
    # Without replacement: the largest of the logarithms of the probabilities, each plus Gumbel noise.
    keys = np.log(chance) + rng.gumbel(size=chance.shape)
    index = np.argpartition(-keys, taken - 1, axis=1)[:, :taken]
    index = index[:, np.arange(count) % taken]
    return ((points[index] - queries[:, None]) / unit).astype(np.float32)
