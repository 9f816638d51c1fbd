"""The cotangent Laplacian of a triangle mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def cotangent_laplacian(vertices: np.ndarray, faces: np.ndarray) -> csr_array:
    """The cotangent Laplacian without mass: negative semi-definite, rows sum to zero.

    ``L_ij = (cot a_ij + cot b_ij) / 2`` for an edge with opposite angles a and b, ``L_ii = -sum_j L_ij`` (Pinkall and
    Polthier 1993). Faces without an area contribute nothing.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (f, 3) int array

    Returns
    -------
    L : (v, v) sparse array

    Example
    -------
    >>> import numpy as np
    >>> V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> cotangent_laplacian(V, np.array([[0, 1, 2]])).toarray()[0, 1]
    np.float64(0.5)
    """
    from scipy.sparse import coo_array

    V, F = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    rows, columns, weights = [], [], []
    for k in range(3):
        i, j, o = F[:, (k + 1) % 3], F[:, (k + 2) % 3], F[:, k]
        u, w = V[i] - V[o], V[j] - V[o]
        area = np.linalg.norm(np.cross(u, w), axis=1)
        # cot = cos / sin = u . w / |u x w|, of the angle opposite the edge (i, j)
        half_cot = np.divide(np.einsum("fi,fi->f", u, w), 2 * area, out=np.zeros(len(F)), where=area > 0)
        rows += [i, j, i, j]
        columns += [j, i, i, j]
        weights += [half_cot, half_cot, -half_cot, -half_cot]
    entries = (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns)))
    return coo_array(entries, shape=(len(V), len(V))).tocsr()
