"""Which faces of a mesh cross other faces of it.

Two faces without a common vertex cross where an edge of the one passes through the inside of the other. Two with one
common vertex cross where the edge opposite to it passes through the other face. Two with a common edge, or in one
plane, only overlap, which is not counted; nor is touching. All is decided in float64 with a tolerance, so that flat
regions and T-junctions do not cross by rounding; crossings shallower than that are missed.

Candidates come from grids, one for each power of two of the faces' sizes: a face is compared with those of its size
and smaller in the cells of its own grid, so long and short triangles may mix. Most of the time is for comparing boxes:
a corner of a box is one integer (:func:`_packed`), so that a comparison is two subtractions, and neighbours in a
cell lie side by side in memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .neighbours import curve_order
from .topology import distinct_positions

TOLERANCE = 1e-12  # of a volume, in units of the size of the mesh times the squared size of the two faces
LEVELS = 16  # smaller faces than 2^-16 of the largest share the finest grid
STEPS = 32  # neighbours in a cell that are compared before those faces are set aside that are known to cross
FEW = 1000  # faces of a size that share the grid of the next size
CHUNK = 200_000  # candidates at a time
PART = 20_000  # pairs at a time where all is done in the processor's cache
BITS = 20  # of a packed coordinate; one bit above each stays free
GUARD = np.int64((1 << BITS) | (1 << (2 * BITS + 1)) | (1 << (3 * BITS + 2)))  # these free bits


def self_intersecting_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which faces cross another one.

    Vertices at equal positions count as one. Faces without an area cross nothing.

    Parameters
    ----------
    vertices : (v, 3) array, finite where a face uses them
    faces : (f, 3) int array

    Returns
    -------
    (f,) bool array
    """
    crossing = np.zeros(len(faces), dtype=bool)
    if not len(faces):
        return crossing
    triangles = _Triangles(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64))
    found = np.zeros(len(triangles.members), dtype=bool)
    for grid in _grids(triangles):
        for i, j in grid.near(found):
            _mark(triangles, i, j, found)
        for i, j in grid.rest(found):
            _mark(triangles, i, j, found)
    crossing[triangles.members] = found
    return crossing


class _Triangles:
    """The faces with an area, along a space-filling curve: corners, normals (twice the area long) and boxes.

    ``members`` are their indices in the mesh; everything else is numbered like these. Axes come first: one look at one
    axis after the other runs through contiguous memory.
    """

    def __init__(self, V: np.ndarray, F: np.ndarray):
        low, high = (ends(ends(V[F[:, 0]], V[F[:, 1]]), V[F[:, 2]]) for ends in (np.minimum, np.maximum))
        middle = (low.min(axis=0) + high.max(axis=0)) / 2
        self.scale = float(np.maximum(high - middle, middle - low).max())
        self.members = curve_order(low + high)
        corners = (V - middle)[F[self.members]].T  # contiguous along the faces: axis, corner, face
        normals = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        extent = (high - low).max(axis=1)[self.members]
        sound = np.flatnonzero(np.sqrt(_dot(normals, normals)) > TOLERANCE * extent**2)
        self.members, self.extent = self.members[sound], extent[sound]
        self.corners, self.normals = np.ascontiguousarray(corners[..., sound]), normals[:, sound]
        self.offsets = _dot(self.corners[:, 0], self.normals)
        self.low, self.high = low[self.members] - middle, high[self.members] - middle
        self.ids = np.ascontiguousarray(distinct_positions(V)[F[self.members]].T, dtype=np.int32)
        width = 2 * self.scale * (1 + 1e-9) / 2**BITS or 1.0
        self.first, self.last = (_packed((c + self.scale) / width) for c in (self.low, self.high))
        self.last |= GUARD

    def overlap(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """Whether the boxes of faces i and j overlap, or nearly do."""
        return ((self.last[j] - self.first[i]) & (self.last[i] - self.first[j]) & GUARD) == GUARD


def _packed(cells: np.ndarray) -> np.ndarray:
    """(n, 3) coordinates in 0..2^BITS, rounded down, in one integer each.

    With the guard bits set in a, all coordinates of a are at least those of b where ``a - b`` keeps the guard bits.
    """
    x, y, z = np.clip(cells, 0, 2**BITS - 1).astype(np.int64).T
    return (x << (2 * BITS + 2)) | (y << (BITS + 1)) | z


class _Grid:
    """Faces sorted by the cells that their boxes touch, at most eight each. A pair has a face of the grid's level."""

    def __init__(self, triangles: _Triangles, level: np.ndarray, smaller: np.ndarray, size: float):
        self.triangles = triangles
        self.of_level = np.zeros(len(triangles.members), dtype=bool)
        self.of_level[level] = True
        key, owner, copy = self._entries(level, size)
        if len(smaller):  # only where a face of the level is
            cells = np.unique(key)
            more = self._entries(smaller, size)
            at = np.minimum(np.searchsorted(cells, more[0]), len(cells) - 1)
            there = cells[at] == more[0]
            key, owner, copy = (np.concatenate([a, b[there]]) for a, b in zip((key, owner, copy), more, strict=True))
        order = np.argsort(key, kind="stable")
        self.key, self.owner, self.copy = key[order], owner[order], copy[order]

    def _entries(self, members: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The cells of faces, the faces, and along which axes this is the second of two cells, as three bits."""
        triangles, shifts = self.triangles, (42, 21, 0)
        low, high = (
            np.floor((ends[members] + triangles.scale) / size).astype(np.int64).T
            for ends in (triangles.low, triangles.high)
        )
        key = sum(cell << shift for cell, shift in zip(low, shifts, strict=True))
        place, copy = np.arange(len(members)), np.zeros(len(members), dtype=np.uint8)
        for axis, shift in enumerate(shifts):
            two = np.flatnonzero((high > low)[axis][place])
            key = np.concatenate([key, key[two] + (1 << shift)])
            place = np.concatenate([place, place[two]])
            copy = np.concatenate([copy, copy[two] | np.uint8(1 << axis)])
        return key, members[place], copy

    def near(self, crossing: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Pairs of faces whose boxes overlap and that are at most :data:`STEPS` places apart in a cell."""
        first, last = self.triangles.first[self.owner], self.triangles.last[self.owner]
        ends = np.append(np.flatnonzero(self.key[1:] != self.key[:-1]), len(self.key) - 1)
        behind = np.repeat(ends, np.diff(ends, prepend=-1)) - np.arange(len(self.key))  # it in the same cell
        for begin in range(0, len(self.key), PART):
            at = np.arange(begin, min(begin + PART, len(self.key)))
            one, other = [], []
            for step in range(1, STEPS + 1):
                at = at[behind[at] >= step]
                if not len(at):
                    break
                to = at + step
                # In the first cell that both touch: in any other, both are in their second cell along some axis.
                found = (self.copy[at] & self.copy[to]) == 0
                found &= ((last[to] - first[at]) & (last[at] - first[to]) & GUARD) == GUARD
                found = np.flatnonzero(found)
                one.append(at[found])
                other.append(to[found])
            if one:
                yield self._wanted(self.owner[np.concatenate(one)], self.owner[np.concatenate(other)], crossing)

    def rest(self, crossing: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The other pairs whose boxes overlap: faces that are not known to cross with those in their cell."""
        starts = np.flatnonzero(np.concatenate([[True], self.key[1:] != self.key[:-1]]))
        sizes = np.diff(np.append(starts, len(self.key)))
        if sizes.max() <= STEPS + 1:
            return
        # A face of the level meets all in its cell, a smaller one those of the level, which stand first.
        is_level = self.of_level[self.owner]
        large = np.add.reduceat(is_level.astype(np.int64), starts)
        start, count = np.repeat(starts, sizes), np.where(is_level, np.repeat(sizes, sizes), np.repeat(large, sizes))
        todo = np.flatnonzero((np.repeat(sizes, sizes) > STEPS + 1) & ~crossing[self.owner])
        while len(todo):
            now = max(1, int(np.searchsorted(np.cumsum(count[todo]), CHUNK)))
            part, todo = todo[:now], todo[now:]
            part = part[~crossing[self.owner[part]]]
            one, many = np.repeat(part, count[part]), count[part]
            other = np.arange(len(one)) - np.repeat(np.cumsum(many) - many, many) + start[one]
            fresh = np.flatnonzero((self.copy[one] & self.copy[other]) == 0)
            i, j = self.owner[one[fresh]], self.owner[other[fresh]]
            overlapping = np.flatnonzero(self.triangles.overlap(i, j))
            yield self._wanted(i[overlapping], j[overlapping], crossing)

    def _wanted(self, i: np.ndarray, j: np.ndarray, crossing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        keep = (i != j) & (self.of_level[i] | self.of_level[j]) & ~(crossing[i] & crossing[j])
        return i[keep], j[keep]


def _grids(triangles: _Triangles) -> Iterator[_Grid]:
    """A grid for each size of faces, with all smaller ones in it."""
    extent = triangles.extent
    if len(extent) < 2:
        return
    finest = max(extent.min(), extent.max() / 2**LEVELS, triangles.scale / 2**19)
    level = np.maximum(np.ceil(np.log2(extent / finest)), 0).astype(int)
    below = np.zeros(len(extent), dtype=bool)
    waiting = below.copy()
    for here in np.unique(level):
        waiting |= level == here
        if waiting.sum() < FEW and here < level.max():
            continue  # a grid for so few is not worth while
        # A cell is a little larger than its faces, so that none touches three cells in a row.
        size = finest * 2.0**here * 1.001
        yield _Grid(triangles, np.flatnonzero(waiting), np.flatnonzero(below), size)
        below |= waiting
        waiting[:] = False


def _mark(triangles: _Triangles, i: np.ndarray, j: np.ndarray, crossing: np.ndarray) -> None:
    """Set ``crossing`` for the faces of those pairs that cross."""
    for begin in range(0, len(i), PART):
        one, other = _crossing_pairs(triangles, i[begin : begin + PART], j[begin : begin + PART])
        crossing[one] = crossing[other] = True


def _crossing_pairs(triangles: _Triangles, i: np.ndarray, j: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Those of the pairs that cross."""
    tolerance = TOLERANCE * triangles.scale * np.maximum(triangles.extent[i], triangles.extent[j]) ** 2
    heights = _heights(triangles, i, j)
    kept = np.flatnonzero(_straddles(heights, tolerance))
    i, j, heights, tolerance = i[kept], j[kept], heights[:, kept], tolerance[kept]
    back = _heights(triangles, j, i)
    kept = np.flatnonzero(_straddles(back, tolerance) & (_shared(triangles, i, j) < 2))
    i, j, tolerance = i[kept], j[kept], tolerance[kept]
    hit = _edges_pierce(triangles, i, j, heights[:, kept], tolerance)
    hit |= _edges_pierce(triangles, j, i, back[:, kept], tolerance)
    return i[hit], j[hit]


def _shared(triangles: _Triangles, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """How many vertices two faces have in common."""
    ours, theirs = ([ids[faces] for ids in triangles.ids] for faces in (i, j))
    return sum((a == b).view(np.int8) for a in ours for b in theirs)


def _heights(triangles: _Triangles, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """(3, n) array: six times the volume between each corner of face i and face j."""
    normals, offsets = [axis[j] for axis in triangles.normals], triangles.offsets[j]
    return np.stack([_dot([axis[i] for axis in triangles.corners[:, k]], normals) - offsets for k in range(3)])


def _straddles(heights: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
    """Whether a face has corners on both sides of a plane, at these heights (3, n) over it."""
    a, b, c = heights
    return (np.maximum(np.maximum(a, b), c) > tolerance) & (np.minimum(np.minimum(a, b), c) < -tolerance)


def _edges_pierce(
    triangles: _Triangles, i: np.ndarray, j: np.ndarray, heights: np.ndarray, tolerance: np.ndarray
) -> np.ndarray:
    """Whether an edge of face i, whose corners have these heights over face j, passes through the inside of j."""
    found = np.zeros(len(i), dtype=bool)
    for k in range(3):
        one, other = heights[k], heights[(k + 1) % 3]
        passes = np.flatnonzero((np.minimum(one, other) < -tolerance) & (np.maximum(one, other) > tolerance))
        ours, theirs = i[passes], j[passes]
        p, q = triangles.corners[:, k, ours], triangles.corners[:, (k + 1) % 3, ours]
        corners = [triangles.corners[:, m, theirs] for m in range(3)]
        # The line p q has all edges of the triangle on one side: three volumes of one sign.
        a, b, c = (_volume(p, q, corners[m], corners[(m + 1) % 3]) for m in range(3))
        lowest, highest = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        found[passes] |= (lowest > tolerance[passes]) | (highest < -tolerance[passes])
    return found


def _volume(p: np.ndarray, q: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Six times the signed volume of tetrahedra, from (3, n) arrays."""
    return _dot(_cross(q - p, a - p), b - p)


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vector products of (3, n) arrays."""
    return np.stack([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])


def _dot(u: Sequence[np.ndarray] | np.ndarray, v: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Scalar products of (3, n) arrays."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
