"""Local quadrics: least-squares paraboloids over the tangent planes of neighbourhoods, many at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

CHUNK = 20_000  # neighbourhoods fitted at once, to bound the memory
RIDGE = 1e-6  # relative weight that keeps fits to few or collinear points at a plane


def project_to_quadrics(queries: np.ndarray, tree: cKDTree, k: int) -> np.ndarray:
    """Move each query onto a quadric fitted to its nearest points, along the normal of their plane.

    The height over the weighted principal plane is a polynomial of degree 2 (a Monge patch, Cazals and Pouget 2005).
    Weights are Gaussian, with the distance of the farthest neighbour as two standard deviations, so that the surface
    hardly jumps where the set of neighbours changes.

    Parameters
    ----------
    queries : (m, 3) array
    tree : cKDTree of the n points that define the surface
    k : int
        Neighbours of a fit; all n if there are fewer.

    Returns
    -------
    (m, 3) float64 array
    """
    projected = np.empty((len(queries), 3))
    for begin in range(0, len(queries), CHUNK):
        part = slice(begin, begin + CHUNK)
        projected[part] = _project(queries[part], tree, min(k, tree.n))
    return projected


def _project(queries: np.ndarray, tree: cKDTree, k: int) -> np.ndarray:
    distance, neighbours = tree.query(queries, k)
    radius = np.maximum(distance[:, -1:], 1e-300)
    weights = np.exp(-2 * (distance / radius) ** 2)
    weights /= weights.sum(axis=1, keepdims=True)
    local = (tree.data[neighbours] - queries[:, None]) / radius[:, :, None]
    center = np.einsum("nk,nki->ni", weights, local)
    local -= center[:, None]
    _, axes = np.linalg.eigh(np.einsum("nk,nki,nkj->nij", weights, local, local))
    axes = axes[:, :, ::-1]  # the two tangents first, then the normal
    u, v, height = np.moveaxis(local @ axes, -1, 0)
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    weighted = weights[:, :, None] * terms
    system = weighted.transpose(0, 2, 1) @ terms + RIDGE * np.diag([0.0, 1, 1, 1, 1, 1])
    right = np.einsum("nkt,nk->nt", weighted, height)
    coefficients = np.linalg.solve(system, right[:, :, None])[:, :, 0]
    u, v, height = np.moveaxis(np.einsum("ni,nij->nj", -center, axes), -1, 0)
    surface = np.einsum("nt,nt->n", coefficients, np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1))
    # A fit that leaves its own neighbourhood is an extrapolation, not a surface.
    return queries + radius * np.clip(surface - height, -1, 1)[:, None] * axes[:, :, 2]
