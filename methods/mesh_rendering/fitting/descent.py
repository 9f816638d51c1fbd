"""Adam, Adam with a common step size, and the coordinates of large steps."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csc_array, eye_array
from scipy.sparse.linalg import splu

from .regularity import edges_of, graph_laplacian

FIRST, SECOND = 0.9, 0.999  # decay rates of the moments
TINY = 1e-12


class Adam:
    """Steps of one array of parameters (Kingma and Ba 2015).

    Parameters
    ----------
    uniform : bool
        Divide all entries by the largest second moment instead of each by its own (AdamUniform, Nicolet et al.
        2021): the step keeps the direction of the gradient.
    """

    def __init__(self, uniform: bool = False):
        self._uniform, self._count = uniform, 0
        self._first = self._second = np.zeros(())

    def step(self, values: np.ndarray, gradient: np.ndarray, rate: float) -> np.ndarray:
        """The values after a step."""
        self._count += 1
        self._first = FIRST * self._first + (1 - FIRST) * gradient
        self._second = SECOND * self._second + (1 - SECOND) * gradient**2
        first = self._first / (1 - FIRST**self._count)
        second = self._second / (1 - SECOND**self._count)
        return values - rate * first / (np.sqrt(second.max() if self._uniform else second) + TINY)


class Diffused:
    """Coordinates u = (I + strength L) v of a mesh, L the graph Laplacian: small steps in u are smooth ones in v.

    The matrix is factorised once.

    Parameters
    ----------
    faces : (f, 3) int array
    count : int
        Of vertices.
    strength : float
        lambda; with 0, u equals the vertices.
    """

    def __init__(self, faces: np.ndarray, count: int, strength: float):
        laplacian = graph_laplacian(edges_of(faces), count)
        self._matrix = csc_array(eye_array(count) + strength * laplacian)
        # Symmetric: a symmetric ordering without pivots keeps the factors small.
        options = {"SymmetricMode": True}
        self._factors = splu(self._matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)

    def of(self, vertices: np.ndarray) -> np.ndarray:
        """u (v, 3) of vertices (v, 3)."""
        return self._matrix @ vertices

    def solve(self, values: np.ndarray) -> np.ndarray:
        """Vertices (v, 3) of u; also the gradient by u from that by vertices, as the matrix is symmetric."""
        return self._factors.solve(np.ascontiguousarray(values))
