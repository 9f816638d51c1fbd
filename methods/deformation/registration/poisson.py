"""Vertices of a mesh from one 3 x 3 matrix for each face: the Poisson equation, and its derivative."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from scipy.sparse import csr_array, diags_array, kron, vstack
from torch import Tensor

from bench.geometry.laplacian import slivers

from .solving import Factors
from .welded import LEAST, Welded, signed_ends


class Poisson:
    """The vertices whose edges are nearest to the source's edges transformed by matrices J_f.

    They minimise ``sum_f sum_(i, j in f) c_fij |(x_i - x_j) - J_f (p_i - p_j)|^2``, with c half the cotangent of the
    angle of f opposite to the edge: the Dirichlet energy of Yu et al. 2004, as in Neural Jacobian Fields (Aigerman et
    al. 2022). It leaves the translation of each part of a mesh free, so the springs between parts are added,
    ``w |(x_i - x_j) - (J_i + J_j) / 2 (p_i - p_j)|^2`` with J_i the mean of J over the faces around i by area. The mesh
    is then connected, and only the centroid is free. If all J are equal, the result is that
    linear map of the source, including gaps between parts.

    Edges of slivers have the small constant c = 0.01 instead: their cotangents are unbounded.

    Parameters
    ----------
    welded : Welded
    """

    def __init__(self, welded: Welded):
        V, F = welded.vertices, welded.faces
        halves = F[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2)  # of each face, the edges opposite to its corners
        ends = signed_ends(np.concatenate([halves, welded.springs]), len(V))
        weights = diags_array(
            np.concatenate([_half_cotangents(V, F).reshape(-1), np.full(len(welded.springs), welded.spring)])
        )
        own = csr_array((np.ones(len(halves)), np.arange(len(halves)) // 3, np.arange(len(halves) + 1)))
        mean = abs(signed_ends(welded.springs, len(V))).T @ _around_vertices(welded) / 2
        used = vstack([own, mean], format="csr")  # the matrix of each edge, as a mean of those of faces
        rest = ends.T @ V
        # Row 3 f + b of the unknowns is the image of axis b under J_f.
        made = sum(kron(diags_array(rest[:, b]) @ used, np.eye(3)[[b]]) for b in range(3))
        self._divergence = csr_array(ends @ weights @ made)
        matrix = csr_array(ends @ weights @ ends.T)
        # Vertex 0 is fixed at the origin. That needs no force, because the right sides sum to zero.
        held = np.zeros(len(V))
        held[0] = matrix.diagonal().mean()
        self._factors = Factors(matrix + diags_array(held))
        self._share = welded.masses / welded.masses.sum()

    def centroid(self, vertices: np.ndarray) -> np.ndarray:
        """(3,) array: the mean of vertices (n, 3), weighted by the areas that they have in the source."""
        return self._share @ vertices

    def solve(self, matrices: np.ndarray) -> np.ndarray:
        """Vertices (n, 3), their centroid at the origin, for matrices (f, 3, 3)."""
        vertices = self._factors.solve(self._divergence @ np.swapaxes(matrices, 1, 2).reshape(-1, 3))
        return vertices - self.centroid(vertices)

    def pull_back(self, gradient: np.ndarray) -> np.ndarray:
        """The gradient (f, 3, 3) by the matrices, from the gradient (n, 3) by the vertices."""
        balanced = gradient - self._share[:, None] * gradient.sum(axis=0)
        columns = self._divergence.T @ self._factors.solve(balanced)
        return np.swapaxes(columns.reshape(-1, 3, 3), 1, 2)

    def __call__(self, matrices: Tensor) -> Tensor:
        """:meth:`solve` of tensors on the CPU, with derivative."""
        return _Solve.apply(matrices, self)


class _Solve(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, matrices: Tensor, poisson: Poisson) -> Tensor:
        ctx.poisson = poisson
        return torch.as_tensor(poisson.solve(matrices.detach().double().numpy())).to(matrices)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return torch.as_tensor(ctx.poisson.pull_back(gradient.double().numpy())).to(gradient), None


def _half_cotangents(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """(f, 3) array: half the cotangent of each angle, or a small constant in slivers."""
    thin = slivers(V, F)
    halves = np.full(F.shape, LEAST)
    for k in range(3):
        u, v = (V[F[~thin, (k + step) % 3]] - V[F[~thin, k]] for step in (1, 2))
        halves[~thin, k] = np.einsum("fi,fi->f", u, v) / np.linalg.norm(np.cross(u, v), axis=1) / 2
    return halves


def _around_vertices(welded: Welded) -> csr_array:
    """The (n, f) matrix that maps values of faces to their means around vertices, by area."""
    count = len(welded.faces)
    least = 1e-6 * welded.areas.mean()  # a vertex may have nothing but faces without area
    entries = np.repeat(np.maximum(welded.areas, least), 3)
    sums = csr_array(
        (entries, (welded.faces.reshape(-1), np.repeat(np.arange(count), 3))), shape=(len(welded.vertices), count)
    )
    total = np.asarray(sums.sum(axis=1)).reshape(-1)
    return csr_array(diags_array(1 / np.where(total > 0, total, 1)) @ sums)
