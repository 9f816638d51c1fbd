"""Regularisers of a mesh: the Laplacian and the lengths of edges."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array


def edges_of(faces: np.ndarray) -> np.ndarray:
    """The edges of faces (f, 3), each once: an (e, 2) int array."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def graph_laplacian(edges: np.ndarray, count: int) -> csr_array:
    """Degrees minus neighbours: a (count, count) positive semi-definite matrix."""
    a, b = edges.T
    ones = np.ones(len(a))
    rows, columns = np.concatenate([a, b, a, b]), np.concatenate([b, a, a, b])
    return csr_array((np.concatenate([-ones, -ones, ones, ones]), (rows, columns)), shape=(count, count))


class Regularity:
    """Two penalties, in units of the initial mean edge length; both are means.

    ``smoothness`` times |v - mean of its neighbours|^2 over vertices, and ``evenness`` times the variance of the
    lengths of edges.

    Parameters
    ----------
    vertices : (v, 3) array
        The initial ones.
    faces : (f, 3) int array
    smoothness, evenness : float
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, smoothness: float, evenness: float):
        self._edges = edges_of(faces)
        self._smoothness, self._evenness = smoothness, evenness
        self._unit = float(np.linalg.norm(vertices[self._edges[:, 0]] - vertices[self._edges[:, 1]], axis=1).mean())
        laplacian = graph_laplacian(self._edges, len(vertices))
        degree = np.maximum(laplacian.diagonal(), 1)
        self._laplacian = csr_array(laplacian.multiply(1 / degree[:, None]))

    def look(self, vertices: np.ndarray) -> tuple[float, np.ndarray]:
        """The sum of both, and its gradient (v, 3)."""
        loss, gradient = 0.0, np.zeros_like(vertices)
        if self._smoothness:
            off = self._laplacian @ vertices
            scale = self._smoothness / (len(vertices) * self._unit**2)
            loss += scale * float((off * off).sum())
            gradient += 2 * scale * (self._laplacian.T @ off)
        if self._evenness:
            a, b = self._edges.T
            along = vertices[b] - vertices[a]
            length = np.linalg.norm(along, axis=1)
            over = length - length.mean()
            scale = self._evenness / (len(length) * self._unit**2)
            loss += scale * float((over * over).sum())
            pull = (2 * scale * over / np.maximum(length, 1e-12))[:, None] * along
            for axis in range(3):
                by_vertex = np.bincount(b, pull[:, axis], len(vertices)) - np.bincount(a, pull[:, axis], len(vertices))
                gradient[:, axis] += by_vertex
        return loss, gradient
