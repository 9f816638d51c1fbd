"""Faces wound so that winding numbers tell inside from outside, whatever order the corners of the file are in."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import BadInput
from .topology import (
    Edges,
    agreeing,
    components_of_faces,
    distinct_positions,
    patches,
    turns_to_agree,
    without_repeats,
)
from .winding import inside

MOST = 0.95  # of the area; where so much agrees, the winding number is above one half nearly everywhere inside
PROBES = 5  # vertices of a component that must all be inside another one
# Of rays whose crossings are counted: no axis and no diagonal of a model, none in a plane with another.
DIRECTIONS = np.array(
    [[0.81, 0.37, 0.46], [-0.29, 0.88, 0.38], [0.41, -0.53, 0.74], [-0.67, -0.31, 0.67], [0.17, 0.62, -0.77]]
)


class NoSides(BadInput):
    """A surface whose faces cannot be wound so that it has an inside; the message says why."""


def oriented(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The faces of a mesh, rewound consistently and outward if they were not.

    Copies of a face count once, however they are wound (a sheet of two sides that sticks out of a solid not at all).
    Then, component by component (faces that hang together through edges): what is wound consistently is trusted, so
    a cavity stays one and a body that is enclosed in another one stays a body; only where such a component lies in no
    other one and is inside out, it is turned with all that it holds. Faces of a component that disagree are turned
    until they agree. It is outward then, or inward where it lies in an odd number of others: a hollow ball keeps its
    cavity. If more than two faces meet in an edge, sides are found by counting how often rays cross the component.
    One that cannot be repaired is unchanged if 95 % of its area agrees, unless it is closed and has only one side:
    surfaces from noisy scans have a few faces that fit nowhere.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (f, 3) int array, f >= 1

    Returns
    -------
    (g, 3) int array, g <= f; ``faces`` itself if nothing is wrong

    Raises
    ------
    NoSides
        If faces disagree and no choice repairs it: a Klein bottle, a sheet in shreds that are wound either way.
    """
    V, F = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    position = distinct_positions(V)[F]
    kept = _without_copies(position)
    F, position = F[kept], position[kept]
    if not len(F):
        return np.asarray(faces)
    parts = _parts(V, F, position)
    turn = _agreeing(V, F, position, parts)
    now = np.where(turn[:, None], F[:, ::-1], F)
    turn ^= _inward(V, now, parts)[parts.of_face]
    if not turn.any() and len(F) == len(faces):
        return np.asarray(faces)
    return np.where(turn[:, None], F[:, ::-1], F)


class _Parts(NamedTuple):
    """The components of a mesh: the one of each face, and which are closed and which have faces that disagree."""

    of_face: np.ndarray
    closed: np.ndarray
    mixed: np.ndarray
    edges: Edges


def _parts(V: np.ndarray, F: np.ndarray, position: np.ndarray) -> _Parts:
    edges = Edges(position)
    count, part = components_of_faces(len(F), edges)
    closed, mixed = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    of_edge = np.empty(len(edges.sizes), dtype=np.int64)
    of_edge[edges.at] = np.repeat(part, 3)
    odd = edges.sizes % 2 == 1
    closed[of_edge[odd]] = False
    mixed[of_edge[~odd & (edges.balance != 0)]] = True
    return _Parts(part, closed, mixed, edges)


# -- copies ------------------------------------------------------------------------------------------------------------


def _without_copies(position: np.ndarray) -> np.ndarray:
    """Indices of the faces that name no position twice, one for each set of positions."""
    sound = np.flatnonzero(without_repeats(position))
    rows = np.sort(position[sound], axis=1)
    order = np.lexsort(rows.T)
    is_new = np.concatenate([[True], (rows[order[1:]] != rows[order[:-1]]).any(axis=1)])[: len(order)]
    if is_new.all():
        return sound
    starts = np.flatnonzero(is_new)
    once = sound[np.sort(order[starts])]
    odd = sound[np.sort(order[starts[np.diff(np.append(starts, len(order))) % 2 == 1]])]
    if not _is_closed(position[once]) and len(odd) and _is_closed(position[odd]):
        return odd
    return once


def _is_closed(position: np.ndarray) -> bool:
    return not (Edges(position).sizes % 2).any()


# -- neighbours --------------------------------------------------------------------------------------------------------


def _agreeing(V: np.ndarray, F: np.ndarray, position: np.ndarray, parts: _Parts) -> np.ndarray:
    """Which faces to turn so that those of each component agree; the side that they then face is arbitrary."""
    turn = np.zeros(len(F), dtype=bool)
    if not parts.mixed.any():
        return turn
    turns, hopeless = turns_to_agree(len(F), parts.edges)
    crowded = (parts.edges.sizes > 2)[parts.edges.at].reshape(-1, 3).any(axis=1)
    mixed = parts.mixed[parts.of_face]
    turn[mixed] = turns[mixed]
    for part in np.unique(parts.of_face[mixed & (crowded | hopeless)]):
        here = np.flatnonzero(parts.of_face == part)
        try:
            turn[here] = _mended(V, F[here], position[here], turn[here], bool(hopeless[here].any()), parts.closed[part])
        except NoSides:
            if (hopeless[here].any() and parts.closed[part]) or _agreeing_share(V, F[here], position[here]) < MOST:
                raise
            turn[here], parts.mixed[part] = False, False  # a few faces that disagree hardly matter
    return turn


def _mended(
    V: np.ndarray, F: np.ndarray, position: np.ndarray, turn: np.ndarray, hopeless: bool, closed: bool
) -> np.ndarray:
    """Which faces of one component to turn where its patches meet in edges of several faces."""
    if hopeless:
        raise NoSides("its faces cannot be wound consistently, as those of a Moebius strip")
    if not closed:
        raise NoSides("its faces are wound inconsistently, and it has both edges of several faces and holes")
    turned = np.where(turn[:, None], F[:, ::-1], F)
    turn = turn ^ _facing_in(V, turned, patches(len(F), Edges(position)))
    if Edges(np.where(turn[:, None], position[:, ::-1], position)).balance.any():
        raise NoSides("its faces are wound inconsistently, and no winding makes its parts agree")
    return turn


def _agreeing_share(V: np.ndarray, F: np.ndarray, position: np.ndarray) -> float:
    """The share of the area in the largest set of faces that agree as they are."""
    a, b, c = np.moveaxis(V[F], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    total = area.sum()
    return float(np.bincount(agreeing(len(F), Edges(position)), weights=area).max() / total) if total > 0 else 0.0


def _facing_in(V: np.ndarray, F: np.ndarray, patch: np.ndarray) -> np.ndarray:
    """Which faces of a closed component face inward, decided for each patch by the rays from its largest face."""
    a, b, c = np.moveaxis(V[F], 1, 0)
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    order = np.lexsort((-area, patch))
    largest = order[np.flatnonzero(np.concatenate([[True], np.diff(patch[order]) > 0]))]
    middle, size = (a + b + c)[largest] / 3, area[largest, None]
    least = 1e-5 * np.ptp(V[F], axis=(0, 1)).max()  # what float32 can tell
    step = normal[largest] / np.where(size > 0, size, 1) * np.maximum(1e-2 * np.sqrt(size), least)
    within = _crossings_are_odd(V, F, np.concatenate([middle + step, middle - step]))
    before, behind = within[: len(largest)], within[len(largest) :]
    if (before == behind).any():
        raise NoSides("its faces are wound inconsistently, and its inner side cannot be found")
    return before[patch]


def _crossings_are_odd(V: np.ndarray, F: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether rays from each of ``points`` (n, 3) cross the faces an odd number of times, by majority of five."""
    from open3d.core import Tensor
    from open3d.t.geometry import RaycastingScene

    corners = V[F].reshape(-1, 3)
    middle, size = corners.mean(axis=0), np.ptp(corners, axis=0).max()
    scene = RaycastingScene(nthreads=1)
    scene.add_triangles(
        Tensor(((corners - middle) / size).astype(np.float32)),
        Tensor(np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)),
    )
    origins = np.repeat((points - middle) / size, len(DIRECTIONS), axis=0)
    rays = np.hstack([origins, np.tile(DIRECTIONS, (len(points), 1))]).astype(np.float32)
    counts = scene.count_intersections(Tensor(rays)).numpy().reshape(len(points), -1)
    return (counts % 2).sum(axis=1) > len(DIRECTIONS) / 2


# -- outward -----------------------------------------------------------------------------------------------------------


def _inward(V: np.ndarray, F: np.ndarray, parts: _Parts) -> np.ndarray:
    """(c,) bool array: which components, now consistent, are to be turned as a whole."""
    bodies = _Bodies(V, F, parts)
    turn = parts.mixed & (bodies.volume < 0)
    if len(turn) == 1:
        return turn
    trusted = ~parts.mixed
    # What is consistent and inside out is a cavity, or a body by itself; what was mended may be a cavity.
    holders = bodies.holders(np.flatnonzero(parts.mixed | (trusted & parts.closed & (bodies.volume < 0))))
    for part, held_by in holders.items():
        if parts.mixed[part]:
            turn[part] ^= len(held_by) % 2 == 1
    roots = [part for part, held_by in holders.items() if trusted[part] and not held_by]
    if roots:
        turn[roots] = True
        for part, held_by in bodies.holders(np.flatnonzero(trusted), roots).items():
            turn[part] |= bool(held_by)
    return turn


class _Bodies:
    """The components as bodies: signed volumes, boxes, and which lies in which."""

    def __init__(self, V: np.ndarray, F: np.ndarray, parts: _Parts):
        self.V, self.F, self.parts = V, F, parts
        count = len(parts.closed)
        self.order = np.argsort(parts.of_face, kind="stable")
        self.starts = np.searchsorted(parts.of_face[self.order], np.arange(count + 1))
        corners = V[F[self.order]]
        self.low = np.minimum.reduceat(corners.min(axis=1), self.starts[:-1])
        self.high = np.maximum.reduceat(corners.max(axis=1), self.starts[:-1])
        middle = np.repeat((self.low + self.high) / 2, np.diff(self.starts), axis=0)
        a, b, c = (corners[:, k] - middle for k in range(3))
        self.volume = np.add.reduceat(np.einsum("ni,ni->n", a, np.cross(b, c)), self.starts[:-1]) / 6

    def faces(self, part: int) -> np.ndarray:
        """The faces of one component."""
        return self.F[self.order[self.starts[part] : self.starts[part + 1]]]

    def holders(self, queries: np.ndarray, among: list[int] | None = None) -> dict[int, list[int]]:
        """For each of some components, the closed ones (``among`` some) that it lies in."""
        held: dict[int, list[int]] = {int(part): [] for part in queries}
        for holder in np.flatnonzero(self.parts.closed).tolist() if among is None else among:
            above, below = self.low[queries] > self.low[holder], self.high[queries] < self.high[holder]
            inner = queries[(above & below).all(axis=1)]
            if not len(inner):
                continue
            probes = np.concatenate([self._probes(part) for part in inner])
            within = inside(self.V, self.faces(holder), probes).reshape(len(inner), PROBES).all(axis=1)
            for part in inner[within]:
                held[int(part)].append(holder)
        return held

    def _probes(self, part: int) -> np.ndarray:
        faces = self.faces(part)
        return self.V[faces[np.linspace(0, len(faces) - 1, PROBES).astype(int), 0]]
