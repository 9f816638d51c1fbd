"""The rotation between two sets of points in correspondence."""

from __future__ import annotations

import numpy as np


def rotation_between(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The rotation R that minimises ``sum_i |R (p_i - mean p) - (q_i - mean q)|^2`` (Kabsch 1976).

    Reflections are excluded. Scale and position of either set do not matter.

    Parameters
    ----------
    source, target : (n, 3) arrays
        Points p and q; point i of the one corresponds to point i of the other.

    Returns
    -------
    (3, 3) float64 array of determinant 1; for rows of points ``source @ R.T``

    Raises
    ------
    ValueError
        If the arrays differ in shape.
    """
    p, q = (np.asarray(points, dtype=np.float64) for points in (source, target))
    if p.shape != q.shape:
        raise ValueError(f"rotation_between: {p.shape} and {q.shape}; expected as many points in both")
    U, _, Vt = np.linalg.svd((q - q.mean(axis=0)).T @ (p - p.mean(axis=0)))
    U[:, 2] *= np.sign(np.linalg.det(U @ Vt))  # where a reflection would fit better still
    return U @ Vt
