"""Skinning: smooth bone weights by heat, and posing by dual quaternions."""

from __future__ import annotations

import numpy as np

TIE = 1e-9  # metres: bones whose distances differ by less are equally near


def heat_weights(V: np.ndarray, F: np.ndarray, joints: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Weights of bones that diffuse along the surface (Baran and Popovic 2007, Eq. 1).

    ``(L + H) W = H P`` with the Laplacian L, H = 1 / d^2 (d: to the nearest bone) and P one at the nearest bone. With
    L an M-matrix, all weights lie in 0..1 and those of a vertex add up to 1.

    Returns
    -------
    (v, bones) array
    """
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import splu

    distance = np.column_stack([_to_segment(V, a, b) for a, b in zip(joints, ends, strict=True)])
    nearest = distance.min(axis=1)
    heat = _masses(V, F) / nearest**2
    owner = (distance <= nearest[:, None] + TIE).astype(float)  # equal up to rounding counts as equal
    owner /= owner.sum(axis=1, keepdims=True)
    W = splu((_laplacian(V, F) + diags_array(heat)).tocsc()).solve(heat[:, None] * owner)
    W = np.maximum(W, 0)
    W[W < 1e-4] = 0
    return W / W.sum(axis=1, keepdims=True)


def _to_segment(x: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    t = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.linalg.norm(x - a - t[:, None] * (b - a), axis=1)


def _masses(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    a, b, c = V[F.T]
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return np.bincount(F.ravel(), weights=np.repeat(areas / 3, 3), minlength=len(V))


def _laplacian(V: np.ndarray, F: np.ndarray):
    """The positive cotangent Laplacian, negative cotangents set to a small positive value."""
    from scipy.sparse import coo_array, diags_array

    i, j, cotangents = [], [], []
    for k in range(3):
        a, b, c = F[:, k], F[:, (k + 1) % 3], F[:, (k + 2) % 3]
        u, v = V[b] - V[a], V[c] - V[a]
        cot = np.einsum("ni,ni->n", u, v) / np.maximum(np.linalg.norm(np.cross(u, v), axis=1), 1e-12)
        i += [b, c]
        j += [c, b]
        cotangents += [cot / 2, cot / 2]
    matrix = coo_array((np.concatenate(cotangents), (np.concatenate(i), np.concatenate(j))), shape=(len(V),) * 2)
    matrix = matrix.tocsr()
    matrix.data = np.clip(matrix.data, 1e-3, 1e3)
    return diags_array(np.asarray(matrix.sum(axis=1)).ravel()) - matrix


def dual_quaternion_skinning(V: np.ndarray, W: np.ndarray, turns: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Pose a mesh (Kavan et al. 2007): every vertex moves rigidly, so bent and twisted limbs keep their volume.

    Parameters
    ----------
    V : (v, 3) array
    W : (v, bones) array of weights that add up to 1
    turns : (bones, 3, 3) array of rotations
    shifts : (bones, 3) array

    Returns
    -------
    (v, 3) array
    """
    from scipy.spatial.transform import Rotation

    real = Rotation.from_matrix(turns).as_quat(scalar_first=True)
    dual = 0.5 * _product(np.column_stack([np.zeros(len(shifts)), shifts]), real)
    # q and -q are the same rotation: each vertex uses the sign that is nearest to its strongest bone.
    signs = np.sign(real @ real.T + 1e-300)[W.argmax(axis=1)] * W
    a, b = signs @ real, signs @ dual
    length = np.linalg.norm(a, axis=1, keepdims=True)
    a, b = a / length, b / length
    turned = V + 2 * np.cross(a[:, 1:], np.cross(a[:, 1:], V) + a[:, :1] * V)
    return turned + 2 * (a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:]))


def _product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The quaternion products, scalar first."""
    scalar = p[:, 0] * q[:, 0] - np.einsum("ni,ni->n", p[:, 1:], q[:, 1:])
    vector = p[:, :1] * q[:, 1:] + q[:, :1] * p[:, 1:] + np.cross(p[:, 1:], q[:, 1:])
    return np.column_stack([scalar, vector])
