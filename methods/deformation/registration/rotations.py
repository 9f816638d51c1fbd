"""As rigid as possible: the energy of a mesh's links, and the rotations that minimise it."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from .welded import signed_ends


class Rigidity:
    """``sum_i sum_j w_ij |(x_i - x_j) - R_i (p_i - p_j)|^2``, the energy of Sorkine and Alexa 2007 (Eq. 3).

    The inner sum is over all links of vertex i, so each link counts twice. Rigid motions have energy 0.

    Parameters
    ----------
    vertices : (n, 3) array
        The p_i.
    links : (l, 2) int array
    weights : (l,) array, positive
    """

    def __init__(self, vertices: np.ndarray, links: np.ndarray, weights: np.ndarray):
        self._ends, self._weights = signed_ends(links, len(vertices)), weights
        self._sums: csr_array = abs(self._ends)  # sums values of links at both ends
        self._links, self._rest = links, self._ends.T @ vertices

    def rotations(self, moved: np.ndarray) -> np.ndarray:
        """(n, 3, 3) rotations that minimise the energy for moved vertices (n, 3), Eq. 6; none is a reflection."""
        now = self._ends.T @ moved
        outer = self._weights[:, None, None] * self._rest[:, :, None] * now[:, None, :]
        covariance = (self._sums @ outer.reshape(-1, 9)).reshape(-1, 3, 3)
        return nearest_rotations(covariance)

    def right_side(self, rotations: np.ndarray) -> np.ndarray:
        """(n, 3) right side of the linear system of Eq. 9, whose matrix is the stiffness of the links."""
        mean = rotations[self._links].sum(axis=1) / 2
        return self._ends @ (self._weights[:, None] * np.einsum("lij,lj->li", mean, self._rest))

    def energy(self, moved: np.ndarray, rotations: np.ndarray) -> float:
        """The energy of moved vertices (n, 3) under rotations (n, 3, 3)."""
        now = self._ends.T @ moved
        off = now[:, None] - np.einsum("leij,lj->lei", rotations[self._links], self._rest)
        return float((self._weights[:, None] * (off**2).sum(axis=-1)).sum())


def nearest_rotations(covariance: np.ndarray) -> np.ndarray:
    """(n, 3, 3) rotations R with the largest trace of R C for covariances C (n, 3, 3), before by after."""
    U, _, Vt = np.linalg.svd(covariance)
    U[:, :, 2] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt))[:, None]
    return np.einsum("nji,nkj->nik", Vt, U)


def moved_rigidly(vertices: np.ndarray, matrix: csr_array, right: np.ndarray) -> np.ndarray:
    """Vertices (n, 3) under the rigid motion that minimises ``x . H x / 2 - r . x``.

    With H the (n, n) ``matrix`` and r the ``right`` side (n, 3). H is a sum of outer products of barycentric
    coordinates, so this is ``sum_s w_s |x_s - g_s|^2``: H and r contain all terms of the Procrustes problem.
    """
    pulled = matrix @ vertices
    total, center, goal = float(matrix.sum()), pulled.sum(axis=0), right.sum(axis=0)
    rotation = nearest_rotations((vertices.T @ right - np.outer(center, goal) / total)[None])[0]
    return (vertices - center / total) @ rotation.T + goal / total
