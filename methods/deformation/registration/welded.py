"""A cleaned source mesh: duplicate vertices welded, unused ones removed, parts joined by springs."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.spatial import cKDTree

from bench.geometry.check import check_mesh
from bench.geometry.laplacian import cotangent_laplacian

from .springs import parts_of, springs_between

if TYPE_CHECKING:
    from trimesh import Trimesh

LEAST, MOST = 1e-2, 1e2  # weights of edges


class Welded:
    """The connected mesh that a deformation is computed on.

    Parameters
    ----------
    source : Trimesh
        May have duplicate or unused vertices, separate parts and slivers.
    reach : float
        Vertices of different parts within this distance have springs.
    spring : float
        The weight of one; an edge of a regular mesh has 0.58.

    Attributes
    ----------
    vertices : (n, 3) array
        The different positions among the corners of faces.
    faces : (f, 3) int array
        Those with three different corners; some may have no area.
    parts : (n,) int array
        The connected part of each vertex, without springs.
    edges, weights : (e, 2) int array, (e,) array
        Each edge once, and half the sum of the cotangents of the angles opposite to it, clamped to 0.01 to 100:
        obtuse angles make it negative, and for slivers it is undefined.
    springs : (s, 2) int array
        See :func:`.springs.springs_between`.

    Raises
    ------
    BadInput
        For a mesh without faces or area, or with coordinates that are not finite.
    """

    def __init__(self, source: Trimesh, reach: float, spring: float):
        check_mesh(source, "source")
        self._given = np.array(source.vertices, dtype=np.float64)
        given = np.asarray(source.faces, dtype=np.int64)
        self._used = np.unique(given)
        self.vertices, self._number = np.unique(self._given[self._used], axis=0, return_inverse=True)
        self._number = self._number.reshape(-1)
        new = np.full(len(self._given), -1)
        new[self._used] = self._number
        faces = new[given]
        self.faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        sides = np.sort(np.concatenate([self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]]), axis=1)
        self.edges = np.unique(sides, axis=0)
        weights = cotangent_laplacian(self.vertices, self.faces)[self.edges[:, 0], self.edges[:, 1]]
        self.weights = np.clip(np.asarray(weights).reshape(-1), LEAST, MOST)
        self.parts = parts_of(self.edges, len(self.vertices))
        self.springs = springs_between(self.vertices, self.parts, reach)
        self.spring = spring

    @property
    def links(self) -> tuple[np.ndarray, np.ndarray]:
        """Edges and springs (l, 2), and the weights of all."""
        springs = np.full(len(self.springs), self.spring)
        return np.concatenate([self.edges, self.springs]), np.concatenate([self.weights, springs])

    @cached_property
    def stiffness(self) -> csr_array:
        """The (n, n) matrix of ``sum w_ij |x_i - x_j|^2`` over the links: positive semi-definite, rows sum to zero."""
        links, weights = self.links
        ends = signed_ends(links, len(self.vertices))
        return csr_array(ends @ diags_array(weights) @ ends.T)

    @cached_property
    def areas(self) -> np.ndarray:
        """(f,) array: of the faces."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2

    @cached_property
    def masses(self) -> np.ndarray:
        """(n,) array: a third of the area of the faces around each vertex."""
        return np.bincount(self.faces.reshape(-1), np.repeat(self.areas / 3, 3), len(self.vertices))

    def mesh(self, source: Trimesh, moved: np.ndarray) -> Trimesh:
        """A copy of the source at the moved vertices (n, 3); a vertex that no face uses moves with the nearest."""
        vertices = self._given.copy()
        vertices[self._used] = moved[self._number]
        unused = np.setdiff1d(np.arange(len(vertices)), self._used)
        if len(unused):
            nearest = cKDTree(self.vertices).query(self._given[unused])[1]
            vertices[unused] += (moved - self.vertices)[nearest]
        output = source.copy()
        output.vertices = vertices
        return output


def signed_ends(links: np.ndarray, count: int) -> csr_array:
    """The (count, l) matrix that sums values of links (l, 2) at their first ends, and subtracts them at the second."""
    number = np.arange(len(links))
    rows, columns = links.T.reshape(-1), np.concatenate([number, number])
    return coo_array((np.repeat([1.0, -1.0], len(links)), (rows, columns)), shape=(count, len(links))).tocsr()
