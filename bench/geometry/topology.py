"""The topology of a triangle mesh: components, genus, boundary, watertightness."""

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
    flipped_faces: int | None
    """the fewest faces to turn so that all neighbours agree; None where nothing does (a Moebius strip), or no faces"""


def count_topology(vertices: np.ndarray, faces: np.ndarray) -> TopologyCounts:
    """Count components, genus and boundary edges of a triangle mesh.

    Vertices at exactly equal positions are merged first, so that a triangle soup (STL) is one surface; faces that
    then name a vertex twice are dropped. Vertices without faces do not count.

    The genus follows from the Euler characteristic, ``V - E + F = 2 C - 2 g - b`` with C components and b boundary
    loops. It is defined for orientable manifolds: at most two faces at an edge, one fan of faces at a vertex.

    Neighbours are the two faces of an edge. They agree where they run along it in opposite directions; what three or
    more faces at an edge should do is not asked.

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
    TopologyCounts(components=1, genus=1, boundary_edges=0, watertight=True, flipped_faces=0)
    """
    F = _merged_faces(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64))
    if not len(F):
        return TopologyCounts(0, None, 0, False, None)
    edges = Edges(F)
    components = components_of_faces(len(F), edges)[0]
    boundary = int((edges.sizes == 1).sum())
    turns, hopeless = turns_to_agree(len(F), edges)
    genus = None
    if edges.sizes.max() <= 2 and not hopeless.any() and _has_single_fans(F, edges):
        euler = int(F.max()) + 1 - len(edges.sizes) + len(F)
        genus = (2 * components - _count_boundary_loops(edges) - euler) // 2
    flipped = None if hopeless.any() else int(turns.sum())
    return TopologyCounts(components, genus, boundary, bool((edges.sizes == 2).all()), flipped)


def pieces(faces: np.ndarray) -> int:
    """How many pieces (f, 3) faces are, that hang together through common vertices."""
    F = np.asarray(faces, dtype=np.int64)
    if not len(F):
        return 0
    used = np.zeros(int(F.max()) + 1, dtype=bool)
    used[F] = True
    count, _ = _components(len(used), F[:, :2].ravel(), F[:, 1:].ravel())
    return count - int((~used).sum())


def distinct_positions(V: np.ndarray) -> np.ndarray:
    """(v,) int array: the number of the position of each vertex, equal where (v, 3) coordinates are exactly equal."""
    order = np.lexsort(V.T)
    differs = (V[order[1:]] != V[order[:-1]]).any(axis=1)
    position = np.empty(len(V), dtype=np.int64)
    position[order] = np.concatenate([[0], np.cumsum(differs)])[: len(V)]
    return position


def without_repeats(F: np.ndarray) -> np.ndarray:
    """(f,) bool array: which faces (f, 3) name no vertex twice."""
    return (F[:, 0] != F[:, 1]) & (F[:, 1] != F[:, 2]) & (F[:, 2] != F[:, 0])


def _merged_faces(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Faces over distinct positions that are numbered without gaps, without those that name a position twice."""
    F = distinct_positions(V)[F]
    F = F[without_repeats(F)]
    used = np.zeros(len(V), dtype=bool)
    used[F] = True
    return (np.cumsum(used) - 1)[F]


class Edges:
    """The edges of a mesh and the half-edges that meet in them. Half-edge 3 f + k runs from corner k of face f on.

    Attributes
    ----------
    start, end : (3 f,) arrays, the vertices of each half-edge
    sizes : (e,) array, how many faces meet in each edge
    lone : half-edges at the boundary
    first, second : half-edges next to each other in the same edge; for two faces one such pair, for k faces k - 1
    of_two : for each such pair, whether its edge has these two faces only
    at : (3 f,) array, the edge of each half-edge
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
        self.at = np.empty(len(key), dtype=np.int64)
        self.at[order] = np.repeat(np.arange(len(self.sizes)), self.sizes)
        self.of_two = np.repeat(self.sizes == 2, np.maximum(self.sizes - 1, 0))

    @property
    def balance(self) -> np.ndarray:
        """(e,) array: how many more half-edges run one way than the other; 0 all over where a solid is bounded."""
        return np.bincount(self.at, weights=np.where(self.start < self.end, 1, -1)).astype(np.int64)

    @property
    def crossed(self) -> np.ndarray:
        """For each pair, whether its half-edges run the same way, so that the two faces are wound inconsistently."""
        return self.start[self.first] == self.start[self.second]


def components_of_faces(faces: int, edges: Edges) -> tuple[int, np.ndarray]:
    """The number of sets of faces that hang together through edges, and the one of each face."""
    return _components(faces, edges.first // 3, edges.second // 3)


def patches(faces: int, edges: Edges) -> np.ndarray:
    """(f,) int array: the patch of each face; neighbours across an edge of two faces are in one."""
    return _components(faces, edges.first[edges.of_two] // 3, edges.second[edges.of_two] // 3)[1]


def turns_to_agree(faces: int, edges: Edges) -> tuple[np.ndarray, np.ndarray]:
    """Which faces to turn so that all neighbours agree, the fewer of the two choices in each patch.

    Returns
    -------
    turns, hopeless : (f,) bool arrays
        The faces to turn, and those of patches in which no choice does it.
    """
    crossed = edges.crossed & edges.of_two
    if not crossed.any():
        return np.zeros(faces, dtype=bool), np.zeros(faces, dtype=bool)
    # In the double cover each face is there as it is and turned; what agrees is connected. A patch that can be made to
    # agree falls into two sheets, which take its faces each the other way round.
    one, two, crossed = (a[edges.of_two] for a in (edges.first // 3, edges.second // 3, crossed))
    _, sheet = _components(
        2 * faces,
        np.concatenate([one, one + faces]),
        np.concatenate([two + crossed * faces, two + ~crossed * faces]),
    )
    as_is, turned = sheet[:faces], sheet[faces:]
    pair = np.minimum(as_is, turned)  # the name of the patch
    in_other = as_is != pair
    size, others = np.bincount(pair), np.bincount(pair, weights=in_other)
    return in_other ^ (2 * others > size)[pair], as_is == turned


def agreeing(faces: int, edges: Edges) -> np.ndarray:
    """(f,) int array: the set of each face in which faces hang together through edges where they agree as they are."""
    forward = edges.start < edges.end
    both = (np.bincount(edges.at[forward], minlength=len(edges.sizes)) > 0) & (
        np.bincount(edges.at[~forward], minlength=len(edges.sizes)) > 0
    )
    through = np.flatnonzero(both[edges.at])
    return _components(faces + len(edges.sizes), through // 3, faces + edges.at[through])[1][:faces]


def _has_single_fans(F: np.ndarray, edges: Edges) -> bool:
    """Whether the corners at each vertex hang together through edges: as many fans as vertices."""
    # Corner k of face f has the number of the half-edge that starts there; the next one in the face is its end.
    following = np.arange(F.size).reshape(F.shape)[:, [1, 2, 0]].ravel()
    first, second, crossed = edges.first, edges.second, edges.crossed
    at_start = np.where(crossed, second, following[second])  # the corner of the second face at the first's start
    at_end = np.where(crossed, following[second], second)
    fans, _ = _components(F.size, np.concatenate([first, following[first]]), np.concatenate([at_start, at_end]))
    return fans == int(F.max()) + 1


def _count_boundary_loops(edges: Edges) -> int:
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
