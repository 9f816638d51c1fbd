"""Repulsion and projection: the regularisers of Eq. 3.14 to 3.18."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ...learned.compiled.pool import in_parts
from ...learned.compiled.threads import in_use, use
from .planes import least_direction
from .settings import Regularity

FAINT = 0.01  # of a point's largest weight: smaller weights do not count in the PCA
NEAR = 1e-4  # added to squared distances
TINY = 1e-12  # of the squared distance: the weight of the point's own normal


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
        # A point is not its own neighbour, even if others coincide with it.
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
        each, gradient = np.zeros(len(points)), np.zeros((len(points), 3))
        places, planes, weights = _float(points, normals, 1 / (1 + np.asarray(hidden)))
        in_parts(_repulsion, len(points), in_use(), places, planes, weights, self.index, *settings, each, gradient)
        return how.repulsion * float(each.mean()), how.repulsion * gradient / len(points)

    def projected(self, points: np.ndarray, normals: np.ndarray, hidden: np.ndarray) -> np.ndarray:
        """The points, moved towards the planes of their neighbours by ``projection`` times the distance (Eq. 3.18).

        Points with fewer than three neighbours do not move. Parameters as for :meth:`repulsion`.

        Returns
        -------
        (n, 3) float64 array
        """
        use(self._threads)
        how = self._how
        released = how.form == "released"
        visible = 1 / (1 + np.asarray(hidden)) ** (2 if released else 1)
        settings = (how.projection_distance, _opening(how.angle), released)
        move = np.zeros((len(points), 3))
        places, planes, weights = _float(points, normals, visible)
        in_parts(_projection, len(points), in_use(), places, planes, weights, self.index, *settings, move)
        return points - how.projection * np.clip(move, -how.largest, how.largest)


def _opening(angle: float) -> float:
    """The divisor of (1 - n.n')^2."""
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

    Neighbours of faint weights do not count; the others count by their squared weights. If they lie on a line, or
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


@njit(nogil=True, cache=True)
def _repulsion(begin, end, points, normals, visible, index, distance, opening, released, loss, gradient):
    for i in range(begin, end):
        _repel(i, points, normals, visible, index, distance, opening, released, loss, gradient)


@njit(cache=True)
def _repel(i, points, normals, visible, index, distance, opening, released, losses, gradient):
    """Set the loss of one point, and its gradient."""
    count = index.shape[1]
    near, weights, total = np.zeros(count), np.zeros(count), 0.0
    for m in range(count):
        near[m], weights[m] = _bilateral(i, index[i, m], points, normals, visible, distance, opening, released)
        total += weights[m]
    if not total > 0:
        return
    for m in range(count):
        weights[m] /= total
    normal, _ = _plane(i, points, normals, index, weights, distance)
    loss, of_all, gx, gy, gz = 0.0, 0.0, 0.0, 0.0, 0.0
    for m in range(count):
        if near[m] == 0:
            continue
        k = index[i, m]
        x, y, z = points[i, 0] - points[k, 0], points[i, 1] - points[k, 1], points[i, 2] - points[k, 2]
        height = x * normal[0] + y * normal[1] + z * normal[2]
        x, y, z = x - height * normal[0], y - height * normal[1], z - height * normal[2]
        squared = x * x + y * y + z * z + NEAR
        of_all += near[m]
        if released:
            loss += near[m] / math.sqrt(squared)
            slope = near[m] / (squared * math.sqrt(squared))
        else:
            loss += near[m] / squared
            slope = 2 * near[m] / (squared * squared)
        gx, gy, gz = gx - slope * x, gy - slope * y, gz - slope * z
    if not released:
        of_all = 1.0
    losses[i] = loss / of_all
    gradient[i, 0], gradient[i, 1], gradient[i, 2] = gx / of_all, gy / of_all, gz / of_all


@njit(nogil=True, cache=True)
def _projection(begin, end, points, normals, visible, index, distance, opening, released, move):
    for i in range(begin, end):
        _project(i, points, normals, visible, index, distance, opening, released, move)


@njit(cache=True)
def _project(i, points, normals, visible, index, distance, opening, released, move):
    """Set the offset of one point to the plane of its neighbours, along its normal: a row of ``move``."""
    count = index.shape[1]
    weights, total, inside = np.zeros(count), 0.0, 0
    for m in range(count):
        near, weights[m] = _bilateral(i, index[i, m], points, normals, visible, distance, opening, released)
        if near > 0:
            inside += 1
            if released:  # twice as wide as that of repulsion
                weights[m] /= math.sqrt(near)
        total += weights[m]
    if inside < 3 or not total > 1e-7:
        return
    for m in range(count):
        weights[m] /= total
    height = 0.0
    if released:
        normal = np.zeros(3)
        for m in range(count):
            k = index[i, m]
            for axis in range(3):
                normal[axis] += weights[m] * normals[k, axis]
                height += weights[m] * (points[i, axis] - points[k, axis]) * normals[k, axis]
        length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        if not length > 0:
            return
        height /= length
    else:
        normal, mean = _plane(i, points, normals, index, weights, distance)
        for axis in range(3):
            height += (points[i, axis] - mean[axis]) * normal[axis]
    for axis in range(3):
        move[i, axis] = height * normal[axis]
