"""Adaptive refinement of meshes of curved surfaces: edges are halved, and their middles moved onto the surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench.geometry.topology import Edges

PASSES, TRIES = 6, 4  # most passes of halving edges; most attempts to do so without crossings
TOLERANCE = 2.5e-4  # for the middle of an edge, relative to the radius about the middle of the box
MOST_FACES = 200_000
WHOLE = -1.0  # replaces the distance of a middle, for edges that must not be halved
# The corners a, b, c of a face and the middles ab, bc, ca are 0 to 5; entry k replaces a face with k halved edges.
PATTERNS = (
    ((0, 1, 2),),
    ((0, 3, 2), (3, 1, 2)),
    ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
)


def refined(
    vertices: np.ndarray,
    faces: np.ndarray,
    onto: Callable[[np.ndarray, np.ndarray], np.ndarray],
    places: np.ndarray | None = None,
    *,
    tolerance: float = TOLERANCE,
    most: int = MOST_FACES,
) -> tuple[np.ndarray, np.ndarray]:
    """Halve edges whose middle is farther than ``tolerance`` from the surface, until none is left or at ``most`` faces.

    In each pass the longest edge of every face with a halved one is halved, too (Rivara 1984), so that triangles do not
    get thinner and thinner; a face with one, two or three halved edges becomes two, three or four. Both faces at an
    edge use the same middle, so a watertight mesh stays watertight and keeps its genus. Where the mesh cuts off a
    crease, middles may move beyond their neighbours: faces whose parts cross others are not divided, nor those around
    them.

    Parameters
    ----------
    vertices : (v, 3) array, on the surface
    faces : (f, 3) int array
    onto : function of middles of edges (n, 3) and the means of the places of their ends (n, m)
        Returns the points of the surface (n, 3) for them.
    places : (f, 3, m) array, optional
        Values at the corners of each face, such as parameters; the value of a middle is the mean of its ends.
    tolerance : float
        Relative to the radius of the mesh about the middle of its box.
    most : int
        If more faces would be needed, the edges farthest from the surface are halved.

    Returns
    -------
    vertices : (w, 3) array, the given ones first
    faces : (g, 3) int array
    """
    from bench.geometry.self_intersections import self_intersecting_faces

    V, F = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    P = np.empty((len(F), 3, 0)) if places is None else places
    middle = (V.min(axis=0) + V.max(axis=0)) / 2
    limit = tolerance * float(np.linalg.norm(V - middle, axis=1).max())
    ends, sides, half = _edges(F)
    a, b = V[ends[:, 0]], V[ends[:, 1]]
    middles = onto((a + b) / 2, _between(P, half))
    away = _line_distances(middles - a, b - a)
    for _ in range(TRIES):
        W, G, origin = _halved(V, F, P, onto, (_key(ends), middles, away), limit, most)
        crossing = self_intersecting_faces(W, G)
        if not crossing.any():
            return W, G
        near = np.zeros(len(V), dtype=bool)
        near[F[origin[crossing]]] = True
        away[sides[near[F].any(axis=1)]] = WHOLE
    return V, F


def _halved(
    V: np.ndarray,
    F: np.ndarray,
    P: np.ndarray,
    onto: Callable[[np.ndarray, np.ndarray], np.ndarray],
    known: tuple[np.ndarray, np.ndarray, np.ndarray],
    limit: float,
    most: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The finer mesh, and the face that each of its faces comes from; ``known``: keys, middles, distances of edges."""
    origin = np.arange(len(F))
    for _ in range(PASSES):
        ends, sides, half = _edges(F)
        middles, away = _known(_key(ends), known)
        new = np.flatnonzero(np.isnan(away))
        if len(new):
            a, b = V[ends[new, 0]], V[ends[new, 1]]
            middles[new] = onto((a + b) / 2, _between(P, half[new]))
            away[new] = _line_distances(middles[new] - a, b - a)
        length = np.linalg.norm(V[ends[:, 0]] - V[ends[:, 1]], axis=1)
        chosen = _chosen(sides, away, length, limit, most)
        if not chosen.any():
            break
        known = _key(ends), middles, away
        number = np.full(len(ends), -1)
        number[chosen] = len(V) + np.arange(chosen.sum())
        V = np.concatenate([V, middles[chosen]])
        F, P, parent = _split(F, P, number[sides])
        origin = origin[parent]
    return V, F, origin


def _between(P: np.ndarray, half: np.ndarray) -> np.ndarray:
    """The means (n, m) of the places at the ends of half-edges (n,)."""
    return (P[half // 3, half % 3] + P[half // 3, (half + 1) % 3]) / 2


def _key(ends: np.ndarray) -> np.ndarray:
    """One number for each edge, ascending."""
    return (ends[:, 0] << 32) + ends[:, 1]


def _line_distances(offsets: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Distances (n,) from the lines of edges (n, 3) to points at ``offsets`` (n, 3) from the starts of the edges."""
    along = np.einsum("ni,ni->n", offsets, edges) / np.maximum(np.einsum("ni,ni->n", edges, edges), 1e-300)
    return np.linalg.norm(offsets - along[:, None] * edges, axis=1)


def _edges(F: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges: their vertices (e, 2), lower first; those of each face, by their first corner (f, 3); a half-edge of each.

    Half-edge 3 f + k starts at corner k of face f.
    """
    edges = Edges(F)
    one = np.unique(edges.at, return_index=True)[1]
    return np.sort(np.stack([edges.start[one], edges.end[one]], axis=1), axis=1), edges.at.reshape(-1, 3), one


def _known(key: np.ndarray, known: tuple[np.ndarray, np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The results of earlier passes for edges, otherwise nan: middles (e, 3) and their distances (e,)."""
    middles, away = np.full((len(key), 3), np.nan), np.full(len(key), np.nan)
    if len(known[0]):
        at = np.minimum(np.searchsorted(known[0], key), len(known[0]) - 1)
        same = known[0][at] == key
        middles[same], away[same] = known[1][at[same]], known[2][at[same]]
    return middles, away


def _chosen(sides: np.ndarray, away: np.ndarray, length: np.ndarray, limit: float, most: int) -> np.ndarray:
    """The edges (e,) to halve: those beyond the limit, and the longest ones of their faces, within ``most`` faces."""
    longest = sides[np.arange(len(sides)), length[sides].argmax(axis=1)]
    one, two, three = sides.T
    for factor in 1.25 ** np.arange(24):
        chosen = away > limit * factor
        while True:
            also = longest[chosen[one] | chosen[two] | chosen[three]]
            also = also[away[also] != WHOLE]
            if chosen[also].all():
                break
            chosen[also] = True
        if len(sides) + chosen[sides.ravel()].sum() <= most:
            return chosen
    return np.zeros(len(away), dtype=bool)


def _split(F: np.ndarray, P: np.ndarray, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces between corners F (f, 3) and new vertices ``middle`` (f, 3) on the edges from each, -1 for none.

    And the places of their corners, and the faces that they come from.
    """
    halved = middle >= 0
    count = halved[:, 0].astype(np.int64) + halved[:, 1] + halved[:, 2]
    # Rotated so that a single halved edge comes first, and with two halved edges the undivided edge comes last.
    first = np.select([count == 1, count == 2], [halved.argmax(axis=1), (halved.argmin(axis=1) + 1) % 3], 0)
    turn = (first[:, None] + np.arange(3)) % 3
    F, P = np.take_along_axis(F, turn, axis=1), np.take_along_axis(P, turn[..., None], axis=1)
    ids = np.concatenate([F, np.take_along_axis(middle, turn, axis=1)], axis=1)
    at = np.concatenate([P, (P + np.roll(P, -1, axis=1)) / 2], axis=1)
    rows = [np.flatnonzero(count == k) for k, parts in enumerate(PATTERNS) for _ in parts]
    corners = [list(part) for parts in PATTERNS for part in parts]
    faces = [ids[chosen][:, part] for chosen, part in zip(rows, corners, strict=True)]
    places = [at[chosen][:, part] for chosen, part in zip(rows, corners, strict=True)]
    return np.concatenate(faces), np.concatenate(places), np.concatenate(rows)
