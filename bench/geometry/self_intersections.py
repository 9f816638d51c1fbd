"""Which faces of a mesh cross other faces of it.

Two faces without a common vertex cross where an edge of the one passes through the inside of the other. Two with one
common vertex cross where the edge opposite to it passes through the other face. Two with a common edge, or in one
plane, only overlap, which is not counted; nor is touching. All is decided in float64 with a tolerance, so that flat
regions and T-junctions do not cross by rounding; crossings shallower than that are missed.

Candidates come from grids, one for each power of two of the faces' sizes: a face is compared with those of its size
and smaller in the cells of its own grid, so long and short triangles may mix.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

TOLERANCE = 1e-12  # of a volume, in units of the size of the mesh times the squared size of the two faces
LEVELS = 16  # smaller faces than 2^-16 of the largest share the finest grid
STEPS = 16  # neighbours in a cell that are compared before those faces are set aside that are known to cross
CHUNK = 1_000_000  # pairs at a time


def self_intersecting_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which faces cross another one.

    Vertices at equal positions count as one. Faces without an area cross nothing.

    Parameters
    ----------
    vertices : (v, 3) array, finite
    faces : (f, 3) int array

    Returns
    -------
    (f,) bool array
    """
    V, at = np.unique(np.asarray(vertices, dtype=np.float64), axis=0, return_inverse=True)
    F = at.ravel()[np.asarray(faces, dtype=np.int64)]
    triangles = _Triangles(V, F)
    crossing = np.zeros(len(F), dtype=bool)
    for grid in _grids(triangles):
        for i, j in grid.near(crossing):
            _mark(triangles, i, j, crossing)
        for i, j in grid.rest(crossing):
            _mark(triangles, i, j, crossing)
    return crossing


class _Triangles:
    """Corners, normals (twice the area long) and boxes of the faces."""

    def __init__(self, V: np.ndarray, F: np.ndarray):
        self.faces = F
        self.corners = V[F] - (V.min(axis=0) + V.max(axis=0)) / 2 if len(F) else np.empty((0, 3, 3))
        a, b, c = np.moveaxis(self.corners, 1, 0)
        self.normals = np.cross(b - a, c - a)
        # Axis by axis, contiguous: most pairs are refused by one look at one axis.
        self.low, self.high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        self.box = [(np.ascontiguousarray(self.low[:, k]), np.ascontiguousarray(self.high[:, k])) for k in range(3)]
        self.ids = [np.ascontiguousarray(F[:, k], dtype=np.int32) for k in range(3)]
        self.extent = (self.high - self.low).max(axis=1)
        self.scale = float(np.abs(self.corners).max()) if len(F) else 0.0
        self.sound = np.linalg.norm(self.normals, axis=1) > TOLERANCE * self.extent**2


class _Grid:
    """Faces sorted by the cells that their boxes touch, at most eight each. A pair has a face of the grid's level."""

    def __init__(self, triangles: _Triangles, members: np.ndarray, of_level: np.ndarray, size: float):
        low = np.floor((triangles.low[members] + triangles.scale) / size).astype(np.int64)
        high = np.floor((triangles.high[members] + triangles.scale) / size).astype(np.int64)
        keys, owners = [], []
        for corner in np.ndindex(2, 2, 2):
            takes_high = np.array(corner, dtype=bool)
            distinct = ((high > low) | ~takes_high).all(axis=1)
            x, y, z = np.where(takes_high, high, low)[distinct].T
            keys.append((x << 42) + (y << 21) + z)
            owners.append(members[distinct])
        key = np.concatenate(keys)
        order = np.argsort(key, kind="stable")
        self.key, self.owner = key[order], np.concatenate(owners)[order]
        self.of_level = of_level

    def near(self, crossing: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Pairs of faces that are at most :data:`STEPS` places apart in a cell."""
        for step in range(1, STEPS + 1):
            same = np.flatnonzero(self.key[step:] == self.key[:-step])
            if not len(same):
                return
            yield self._wanted(self.owner[same], self.owner[same + step], crossing)

    def rest(self, crossing: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The other pairs, of faces that are not known to cross with all in their cell."""
        starts = np.flatnonzero(np.concatenate([[True], self.key[1:] != self.key[:-1]])) if len(self.key) else []
        sizes = np.diff(np.append(starts, len(self.key)))
        if not len(sizes) or sizes.max() <= STEPS + 1:
            return
        start, size = np.repeat(starts, sizes), np.repeat(sizes, sizes)
        todo = np.flatnonzero((size > STEPS + 1) & ~crossing[self.owner])
        while len(todo):
            count = max(1, int(np.searchsorted(np.cumsum(size[todo]), CHUNK)))
            part, todo = todo[:count], todo[count:]
            part = part[~crossing[self.owner[part]]]
            one = np.repeat(part, size[part])
            place = np.arange(len(one)) - np.repeat(np.cumsum(size[part]) - size[part], size[part])
            yield self._wanted(self.owner[one], self.owner[start[one] + place], crossing)

    def _wanted(self, i: np.ndarray, j: np.ndarray, crossing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        keep = (i != j) & (self.of_level[i] | self.of_level[j]) & ~(crossing[i] & crossing[j])
        return i[keep], j[keep]


def _grids(triangles: _Triangles) -> Iterator[_Grid]:
    """A grid for each size of faces, with all smaller ones in it."""
    sound = np.flatnonzero(triangles.sound)
    if len(sound) < 2:
        return
    extent = triangles.extent[sound]
    finest = max(extent.min(), extent.max() / 2**LEVELS, triangles.scale / 2**19)
    level = np.maximum(np.ceil(np.log2(extent / finest)), 0).astype(int)
    for here in np.unique(level):
        of_level = np.zeros(len(triangles.faces), dtype=bool)
        of_level[sound[level == here]] = True
        # A cell is a little larger than its faces, so that none touches three cells in a row.
        yield _Grid(triangles, sound[level <= here], of_level, finest * 2.0**here * 1.001)


def _mark(triangles: _Triangles, i: np.ndarray, j: np.ndarray, crossing: np.ndarray) -> None:
    """Set ``crossing`` for the faces of those pairs that cross."""
    for low, high in triangles.box:
        near = (low[i] <= high[j]) & (low[j] <= high[i])
        i, j = i[near], j[near]
    ours, theirs = ([ids[faces] for ids in triangles.ids] for faces in (i, j))
    shared = sum((a == b).view(np.int8) for a in ours for b in theirs)
    i, j = i[shared < 2], j[shared < 2]
    tolerance = TOLERANCE * triangles.scale * np.maximum(triangles.extent[i], triangles.extent[j]) ** 2
    for one, other in ((0, 1), (1, 0)):
        pair = (i, j)
        straddling = _straddles(triangles, pair[one], pair[other], tolerance)
        i, j, tolerance = i[straddling], j[straddling], tolerance[straddling]
    hit = _edges_pierce(triangles, i, j, tolerance) | _edges_pierce(triangles, j, i, tolerance)
    crossing[i[hit]] = crossing[j[hit]] = True


def _heights(triangles: _Triangles, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """(n, 3) array: six times the volume between each corner of face i and face j."""
    normals = triangles.normals[j]
    base = np.einsum("ni,ni->n", triangles.corners[j, 0], normals)
    return np.einsum("nki,ni->nk", triangles.corners[i], normals) - base[:, None]


def _straddles(triangles: _Triangles, i: np.ndarray, j: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
    """Whether face i has corners on both sides of the plane of face j."""
    a, b, c = _heights(triangles, i, j).T
    return (np.maximum(np.maximum(a, b), c) > tolerance) & (np.minimum(np.minimum(a, b), c) < -tolerance)


def _edges_pierce(triangles: _Triangles, i: np.ndarray, j: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
    """Whether an edge of face i passes through the inside of face j."""
    heights, P, T = _heights(triangles, i, j), triangles.corners[i], triangles.corners[j]
    found = np.zeros(len(i), dtype=bool)
    for k in range(3):
        p, q = P[:, k], P[:, (k + 1) % 3]
        one, other = heights[:, k], heights[:, (k + 1) % 3]
        passes = (np.minimum(one, other) < -tolerance) & (np.maximum(one, other) > tolerance)
        # The line p q has all edges of the triangle on one side: three volumes of one sign.
        sides = np.stack([_volume(p, q, T[:, m], T[:, (m + 1) % 3]) for m in range(3)], axis=1)
        found |= passes & ((sides > tolerance[:, None]).all(axis=1) | (sides < -tolerance[:, None]).all(axis=1))
    return found


def _volume(p: np.ndarray, q: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Six times the signed volume of tetrahedra."""
    return np.einsum("ni,ni->n", np.cross(q - p, a - p), b - p)
