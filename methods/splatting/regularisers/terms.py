"""Repulsion and projection: the regularisers of Eq. 3.14 to 3.18."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from ...learned.compiled.threads import use
from .planes import least_direction
from .settings import Regularity

FAINT = 0.01  # of a point's largest weight: less does not count in the PCA
NEAR = 1e-4  # added to squared distances
TINY = 1e-12  # of the squared distance: how much the point's own normal says


class Neighbours:
    """Points with their neighbours, for one or more steps of an optimisation.

    Parameters
    ----------
    points : (n, 3) array
    how : Regularity
    threads : int
    """

    def __init__(self, points: np.ndarray, how: Regularity, threads: int = 1):
        from scipy.spatial import cKDTree

        self._how, self._threads = how, threads
        k = min(how.neighbours + 1, len(points))
        _, index = cKDTree(points).query(points, np.arange(1, k + 1), workers=threads)
        # A point is not its own neighbour, also where others coincide with it.
        own = index == np.arange(len(points))[:, None]
        own[~own.any(axis=1), -1] = True
        self.index = index[~own].reshape(len(points), k - 1)

    def repulsion(self, points: np.ndarray, normals: np.ndarray, hidden: np.ndarray) -> tuple[float, np.ndarray]:
        """The loss of Eq. 3.17, times its weight, and its gradient.

        Only the point itself moves: neighbours, weights and planes are constants.

        Parameters
        ----------
        points, normals : (n, 3) arrays
        hidden : (n,) array
            o_k of Eq. 3.16: how often each point is hidden.

        Returns
        -------
        float, (n, 3) float64 array
        """
        use(self._threads)
        how = self._how
        settings = (how.repulsion_distance, _opening(how.angle), how.form == "released")
        each, gradient = _repulsion(*_float(points, normals, 1 / (1 + np.asarray(hidden))), self.index, *settings)
        return how.repulsion * float(each.mean()), how.repulsion * gradient / len(points)

    def projected(self, points: np.ndarray, normals: np.ndarray, hidden: np.ndarray) -> np.ndarray:
        """The points, moved towards the planes of their neighbours by ``projection`` times the distance (Eq. 3.18).

        Points with fewer than three neighbours stay. Parameters as of :meth:`repulsion`.

        Returns
        -------
        (n, 3) float64 array
        """
        use(self._threads)
        how = self._how
        released = how.form == "released"
        visible = 1 / (1 + np.asarray(hidden)) ** (2 if released else 1)
        settings = (how.projection_distance, _opening(how.angle), released)
        move = _projection(*_float(points, normals, visible), self.index, *settings)
        return points - how.projection * np.clip(move, -how.largest, how.largest)


def _opening(angle: float) -> float:
    """What (1 - n.n')^2 is divided by."""
    return max(1e-5, 1 - math.cos(math.radians(angle))) ** 2


def _float(*arrays: np.ndarray) -> list[np.ndarray]:
    return [np.ascontiguousarray(array, dtype=np.float64) for array in arrays]


@njit(cache=True)
def _bilateral(i, k, points, normals, visible, distance, opening, released):
    """psi, and psi theta phi, of a neighbour: both 0 beyond the distance."""
    squared, cosine = 0.0, 0.0
    for axis in range(3):
        squared += (points[k, axis] - points[i, axis]) ** 2
        cosine += normals[k, axis] * normals[i, axis]
    if squared > distance * distance:
        return 0.0, 0.0
    near = math.exp(-squared / (distance * distance * (2.0 if released else 1.0)))
    return near, near * math.exp(-((1 - cosine) ** 2) / opening) * visible[k]


@njit(cache=True)
def _plane(i, points, normals, index, weights, distance):
    """The normal of the plane through the neighbours (3,), and their weighted mean (3,); weights add up to 1.

    Neighbours of faint weights do not count; the others count by the squares of theirs. Where they lie on a line, or
    are too few, the point's own normal decides.
    """
    mean, covariance = np.zeros(3), np.zeros((3, 3))
    for m in range(index.shape[1]):
        for axis in range(3):
            mean[axis] += weights[m] * points[index[i, m], axis]
    least = FAINT * weights.max()
    for m in range(index.shape[1]):
        if weights[m] < least:
            continue
        for a in range(3):
            for b in range(3):
                offset = (points[index[i, m], a] - mean[a]) * (points[index[i, m], b] - mean[b])
                covariance[a, b] += weights[m] * weights[m] * offset
    for a in range(3):
        for b in range(3):
            covariance[a, b] += TINY * distance * distance * ((a == b) - normals[i, a] * normals[i, b])
    return least_direction(covariance), mean


@njit(parallel=True, cache=True)
def _repulsion(points, normals, visible, index, distance, opening, released):
    n, count = index.shape
    loss, gradient = np.zeros(n), np.zeros((n, 3))
    for i in prange(n):
        near, weights = np.zeros(count), np.zeros(count)
        for m in range(count):
            near[m], weights[m] = _bilateral(i, index[i, m], points, normals, visible, distance, opening, released)
        if not weights.sum() > 0:
            continue
        weights /= weights.sum()
        normal, _ = _plane(i, points, normals, index, weights, distance)
        of_all = 0.0
        slope = np.zeros(3)
        for m in range(count):
            if near[m] == 0:
                continue
            offset = points[i] - points[index[i, m]]
            offset = offset - (offset[0] * normal[0] + offset[1] * normal[1] + offset[2] * normal[2]) * normal
            squared = offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2 + NEAR
            of_all += near[m]
            if released:
                loss[i] += near[m] / math.sqrt(squared)
                slope -= near[m] / (squared * math.sqrt(squared)) * offset
            else:
                loss[i] += near[m] / squared
                slope -= 2 * near[m] / (squared * squared) * offset
        if released:
            loss[i] /= of_all
            slope /= of_all
        gradient[i] = slope
    return loss, gradient


@njit(parallel=True, cache=True)
def _projection(points, normals, visible, index, distance, opening, released):
    n, count = index.shape
    move = np.zeros((n, 3))
    for i in prange(n):
        weights = np.zeros(count)
        inside = 0
        for m in range(count):
            k = index[i, m]
            near, weights[m] = _bilateral(i, k, points, normals, visible, distance, opening, released)
            if near > 0:
                inside += 1
                if released:  # twice as wide as that of repulsion
                    weights[m] /= math.sqrt(near)
        total = weights.sum()
        if inside < 3 or not total > 1e-7:
            continue
        weights /= total
        if released:
            normal, height = np.zeros(3), 0.0
            for m in range(count):
                k = index[i, m]
                for axis in range(3):
                    normal[axis] += weights[m] * normals[k, axis]
                    height += weights[m] * (points[i, axis] - points[k, axis]) * normals[k, axis]
            length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
            if length > 0:
                move[i] = height / length * normal
        else:
            normal, mean = _plane(i, points, normals, index, weights, distance)
            height = 0.0
            for axis in range(3):
                height += (points[i, axis] - mean[axis]) * normal[axis]
            move[i] = height * normal
    return move
