"""What kind of surface a triangle mesh is: components, genus, boundary, watertightness."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class TopologyCounts(NamedTuple):
    """The counts of one mesh."""

    components: int
    """sets of faces connected through edges"""
    genus: int | None
    """sum over the components; None where the surface is not manifold or not orientable, or has no faces"""
    boundary_edges: int
    """edges of exactly one face"""
    watertight: bool
    """whether every edge belongs to exactly two faces"""


def count_topology(vertices: np.ndarray, faces: np.ndarray) -> TopologyCounts:
    """Count components, genus and boundary edges of a triangle mesh.

    Vertices at exactly equal positions are merged first, so that a triangle soup (STL) is one surface; faces that
    then name a vertex twice are dropped. Vertices without faces do not count.

    The genus follows from the Euler characteristic, ``V - E + F = 2 C - 2 g - b`` with C components and b boundary
    loops. It is defined for orientable manifolds: at most two faces at an edge, one fan of faces at a vertex.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (f, 3) int array

    Returns
    -------
    TopologyCounts

    Example
    -------
    >>> import trimesh
    >>> torus = trimesh.creation.torus(1.0, 0.3)
    >>> count_topology(torus.vertices, torus.faces)
    TopologyCounts(components=1, genus=1, boundary_edges=0, watertight=True)
    """
    F = _merged_faces(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64))
    if not len(F):
        return TopologyCounts(0, None, 0, False)
    edges = _Edges(F)
    components = _count_components(len(F), edges.first, edges.second)
    boundary = int((edges.sizes == 1).sum())
    genus = None
    if edges.sizes.max() <= 2 and _is_orientable(len(F), components, edges) and _has_single_fans(F, edges):
        euler = int(F.max()) + 1 - len(edges.sizes) + len(F)
        genus = (2 * components - _count_boundary_loops(edges) - euler) // 2
    return TopologyCounts(components, genus, boundary, bool((edges.sizes == 2).all()))


def distinct_positions(V: np.ndarray) -> np.ndarray:
    """(v,) int array: the number of the position of each vertex, equal where (v, 3) coordinates are exactly equal."""
    order = np.lexsort(V.T)
    differs = (V[order[1:]] != V[order[:-1]]).any(axis=1)
    position = np.empty(len(V), dtype=np.int64)
    position[order] = np.concatenate([[0], np.cumsum(differs)])[: len(V)]
    return position


def _merged_faces(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Faces over distinct positions that are numbered without gaps, without those that name a position twice."""
    F = distinct_positions(V)[F]
    F = F[(F[:, 0] != F[:, 1]) & (F[:, 1] != F[:, 2]) & (F[:, 2] != F[:, 0])]
    used = np.zeros(len(V), dtype=bool)
    used[F] = True
    return (np.cumsum(used) - 1)[F]


class _Edges:
    """The edges of a mesh and the half-edges that meet in them. Half-edge 3 f + k runs from corner k of face f on.

    Attributes
    ----------
    start, end : (3 f,) arrays, the vertices of each half-edge
    sizes : (e,) array, how many faces meet in each edge
    lone : half-edges at the boundary
    first, second : half-edges next to each other in the same edge; for two faces one such pair, for k faces k - 1
    """

    def __init__(self, F: np.ndarray):
        self.start, self.end = F.ravel(), np.roll(F, -1, axis=1).ravel()
        key = np.minimum(self.start, self.end) * (int(F.max()) + 1) + np.maximum(self.start, self.end)
        order = np.argsort(key, kind="stable")
        same = key[order[1:]] == key[order[:-1]]
        begins = np.flatnonzero(np.concatenate([[True], ~same]))
        self.sizes = np.diff(np.append(begins, len(key)))
        self.lone = order[begins[self.sizes == 1]]
        self.first, self.second = order[:-1][same], order[1:][same]

    @property
    def crossed(self) -> np.ndarray:
        """For each pair, whether its half-edges run the same way, so that the two faces are wound inconsistently."""
        return self.start[self.first] == self.start[self.second]


def _count_components(faces: int, first: np.ndarray, second: np.ndarray) -> int:
    return _components(faces, first // 3, second // 3)[0]


def _is_orientable(faces: int, components: int, edges: _Edges) -> bool:
    """Whether flipping some faces makes all consistent: then each component's double cover falls into two."""
    crossed = edges.crossed
    if not crossed.any():
        return True
    one, two = edges.first // 3, edges.second // 3
    sheet_two = two + crossed * faces  # sheet + of face one meets sheet + of face two, or - where they disagree
    other_two = two + ~crossed * faces
    sheets, _ = _components(2 * faces, np.concatenate([one, one + faces]), np.concatenate([sheet_two, other_two]))
    return sheets == 2 * components


def _has_single_fans(F: np.ndarray, edges: _Edges) -> bool:
    """Whether the corners at each vertex hang together through edges: as many fans as vertices."""
    # Corner k of face f has the number of the half-edge that starts there; the next one in the face is its end.
    following = np.arange(F.size).reshape(F.shape)[:, [1, 2, 0]].ravel()
    first, second, crossed = edges.first, edges.second, edges.crossed
    at_start = np.where(crossed, second, following[second])  # the corner of the second face at the first's start
    at_end = np.where(crossed, following[second], second)
    fans, _ = _components(F.size, np.concatenate([first, following[first]]), np.concatenate([at_start, at_end]))
    return fans == int(F.max()) + 1


def _count_boundary_loops(edges: _Edges) -> int:
    if not len(edges.lone):
        return 0
    ends = np.unique(np.concatenate([edges.start[edges.lone], edges.end[edges.lone]]), return_inverse=True)[1]
    return _components(int(ends.max()) + 1, *np.split(ends, 2))[0]


def _components(nodes: int, a: np.ndarray, b: np.ndarray) -> tuple[int, np.ndarray]:
    """The number of connected components of an undirected graph with edges (a, b), and the one of each node."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(a), dtype=bool), (a, b)), shape=(nodes, nodes))
    return connected_components(graph, directed=False)
