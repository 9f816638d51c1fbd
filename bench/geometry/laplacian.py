"""The cotangent Laplacian of a triangle mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csr_array


SLIVER = 0.02  # of the shape of the thinnest faces that make up these shares of the mesh
AREA_SHARE, FACE_SHARE = 0.01, 0.2
FLAT = 1e-5  # height over longest edge that is never intended


def cotangent_laplacian(vertices: np.ndarray, faces: np.ndarray) -> csr_array:
    """The cotangent Laplacian without mass: negative semi-definite, rows sum to zero.

    ``L_ij = (cot a_ij + cot b_ij) / 2`` for an edge with opposite angles a and b, ``L_ii = -sum_j L_ij`` (Pinkall and
    Polthier 1993). Faces without an area contribute nothing, nor do :func:`slivers`: the cotangents of a face of height
    h grow like 1 / h, so one that is thin by accident would outweigh all others. Sharp and Crane 2020 give each
    triangle a least height instead and flip edges; without slivers nothing is changed here.

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
    F = F[~slivers(V, F)]
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


def slivers(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which faces are far thinner than the surface is tessellated, or have no area: an (f,) bool array.

    With s the height of a face over its longest edge (0.87 for an equilateral one, 0 for a flat one), the faces of the
    smallest s that make up a hundredth of the area, or a fifth of all faces, reach some s_0. Slivers are those below
    0.02 s_0, and those below 1e-5 in any case (but for meshes whose area is in such faces). A mesh that is made of long
    strips, or a plate with a narrow rim, has none.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (f, 3) int array
    """
    a, b, c = np.moveaxis(np.asarray(vertices, dtype=np.float64)[np.asarray(faces, dtype=np.int64)], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([np.einsum("ni,ni->n", edge, edge) for edge in (b - a, c - b, a - c)], axis=0)
    shape = np.divide(area, longest, out=np.zeros(len(area)), where=longest > 0)
    order = np.argsort(shape, kind="stable")
    total = np.cumsum(area[order])
    if not len(area) or not total[-1] > 0:
        return np.ones(len(area), dtype=bool)
    of_area = shape[order[np.searchsorted(total, AREA_SHARE * total[-1])]]
    of_faces = shape[order[int(FACE_SHARE * len(area))]]
    return (area == 0) | (shape < SLIVER * min(of_area, of_faces)) | (shape < min(FLAT, SLIVER * of_area))
