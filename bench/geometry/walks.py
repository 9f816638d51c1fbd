"""Straight walks over a triangle mesh: what the normal does on the way, along the surface and never through the air.

A walk goes straight on across each edge (the two faces unfolded into one plane), so its length is a length on the
surface: the other side of a thin sheet is as far away as the way round its rim.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

CREASE_DEGREES = 30.0  # faces that turn by more are two sides of an edge, by less a tessellation of something round
FLAT = 1e-12  # a face with less than this share of its longest edge's square has no normal
MOST_AROUND = 256  # faces at one vertex that are compared with one another
MOST_STEPS = 400  # of a walk, over faces and stops


class Terrain:
    """A mesh to walk over. Vertices at equal positions count as one, faces without an area are left out.

    Walks end at the boundary, and where more than two faces meet in an edge. Faces that are wound against each other
    are walked over as if they were not.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (f, 3) int array
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        V, F = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
        order = np.lexsort(V.T)
        differs = np.concatenate([[True], (V[order[1:]] != V[order[:-1]]).any(axis=1)])[: len(V)]
        place = np.empty(len(V), dtype=np.int64)
        place[order] = np.cumsum(differs) - 1
        V, F = V[order[differs]], place[F]
        a, b, c = (V[F[:, k]] for k in range(3))
        across = np.cross(b - a, c - a)
        longest = np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
        double = np.linalg.norm(across, axis=1)
        solid = double > FLAT * np.maximum(longest, 1e-300)
        self.vertices, self.faces = V, F[solid]
        self.areas = double[solid] / 2
        self.normals = across[solid] / double[solid, None]
        self.corners = np.stack([a, b, c], axis=1)[solid]

    @cached_property
    def boxes(self) -> tuple[np.ndarray, np.ndarray]:
        """The least and the largest coordinates of each face: two (3, f) arrays."""
        a, b, c = (np.ascontiguousarray(self.corners[:, k].T) for k in range(3))
        return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)

    @cached_property
    def half_edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors along half-edge 3 f + k (from corner k on), and inwards from it in its face: two (3 f, 3)."""
        along = np.roll(self.corners, -1, axis=1) - self.corners
        along /= np.linalg.norm(along, axis=2, keepdims=True)
        inwards = np.cross(self.normals[:, None], along)
        return along.reshape(-1, 3), inwards.reshape(-1, 3)

    @cached_property
    def rates(self) -> np.ndarray:
        """(f, 3, 3) array: how fast the barycentric coordinate of corner k changes along x, y and z."""
        # Corner k faces the half-edge from corner k + 1 on; its coordinate is the height over it by that of the corner.
        sides = np.roll(self.corners, -2, axis=1) - np.roll(self.corners, -1, axis=1)
        return np.cross(self.normals[:, None], sides) / (2 * self.areas)[:, None, None]

    @cached_property
    def opposite(self) -> np.ndarray:
        """(3 f,) the half-edge on the other side of each; -1 at the boundary and where more than two faces meet."""
        start, end = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        key = np.minimum(start, end) * (len(self.vertices) + 1) + np.maximum(start, end)
        order = np.argsort(key, kind="stable")
        begins = np.flatnonzero(np.concatenate([[True], key[order[1:]] != key[order[:-1]]])[: len(key)])
        pairs = begins[np.diff(np.append(begins, len(key))) == 2]
        opposite = np.full(len(key), -1)
        one, other = order[pairs], order[pairs + 1] if len(pairs) else order[pairs]
        opposite[one], opposite[other] = other, one
        return opposite

    @cached_property
    def corner_normals(self) -> np.ndarray:
        """(f, 3, 3) unit normals at the corners of the faces, of the round surface that the mesh stands for.

        At a corner, the mean of the normals of all faces about the vertex that turn by less than
        :data:`CREASE_DEGREES` against the corner's own face, weighted by their angles there.
        """
        P, count = self.corners, len(self.vertices)
        one, two = np.roll(P, -1, axis=1) - P, np.roll(P, -2, axis=1) - P
        cosine = np.einsum("fki,fki->fk", one, two) / (np.linalg.norm(one, axis=2) * np.linalg.norm(two, axis=2))
        angle = np.arccos(np.clip(cosine, -1, 1)).ravel()
        vertex, face = self.faces.ravel(), np.repeat(np.arange(len(P)), 3)
        weighted = angle[:, None] * self.normals[face]
        total = np.stack([np.bincount(vertex, weighted[:, k], minlength=count) for k in range(3)], axis=1)
        result = total[vertex]
        result /= np.maximum(np.linalg.norm(result, axis=1, keepdims=True), 1e-300)
        # Where all normals are within half the angle of their mean, all pairs are within the angle.
        apart = np.einsum("ni,ni->n", result, self.normals[face]) < np.cos(np.radians(CREASE_DEGREES / 2))
        creased = np.zeros(count, dtype=bool)
        creased[vertex[apart]] = True
        at = np.flatnonzero(creased[vertex])
        result[at] = self.normals[face[at]]
        at = at[np.argsort(vertex[at], kind="stable")]
        begin, size = np.unique(vertex[at], return_index=True, return_counts=True)[1:]
        few = np.repeat(size <= MOST_AROUND, size)
        i = np.repeat(np.arange(len(at)), np.where(few, np.repeat(size, size), 0))
        first = np.repeat(begin, size)
        j = first[i] + np.arange(len(i)) - np.searchsorted(i, np.arange(len(at)))[i]
        i, j = at[i], at[j]
        same = np.einsum("ni,ni->n", self.normals[face[i]], self.normals[face[j]]) > np.cos(np.radians(CREASE_DEGREES))
        i, j = i[same], j[same]
        total = np.stack([np.bincount(i, weighted[j, k], minlength=len(vertex)) for k in range(3)], axis=1)
        some = np.flatnonzero(np.linalg.norm(total, axis=1) > 0)
        result[some] = total[some] / np.linalg.norm(total[some], axis=1, keepdims=True)
        return result.reshape(-1, 3, 3)

    def normals_at(self, faces: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(n, 3) unit normals at points of faces, given by their barycentric coordinates (n, 3)."""
        normals = np.einsum("nk,nki->ni", weights, self.corner_normals.take(faces, axis=0))
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)

    def weights_at(self, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(n, 3) barycentric coordinates of points in their faces."""
        from_first = np.einsum("nki,ni->nk", self.rates.take(faces, axis=0), points - self.corners[faces, 0])
        weights = np.clip(from_first + [1, 0, 0], 0, 1)
        return weights / weights.sum(axis=1, keepdims=True)

    def walk(self, faces: np.ndarray, points: np.ndarray, angles: np.ndarray, stops: np.ndarray) -> np.ndarray:
        """Walk from ``points`` (n, 3) in ``faces`` (n,), each in the direction ``angles`` (n,) from its first edge.

        Parameters
        ----------
        stops : (n, s) or (s,) array
            Ascending lengths of the walks at which normals are wanted.

        Returns
        -------
        (n, s, 3) array
            Unit normals at the stops, on the side that the walk began on; zero beyond the end of a walk.
        """
        along, inwards = self.half_edges
        n, face = len(faces), np.array(faces)
        stops = np.broadcast_to(stops, (n, np.shape(stops)[-1]))
        direction = np.cos(angles)[:, None] * along[3 * face] + np.sin(angles)[:, None] * inwards[3 * face]
        weights, way, stop, sign = self.weights_at(face, points), np.zeros(n), np.zeros(n, dtype=np.int64), np.ones(n)
        found = np.zeros((n, stops.shape[1], 3))
        rows = np.arange(n)
        for _ in range(MOST_STEPS):
            rate = np.einsum("nki,ni->nk", self.rates.take(face, axis=0), direction)
            with np.errstate(divide="ignore", invalid="ignore"):
                until = np.where(rate < 0, weights / -rate, np.inf)
            corner = until.argmin(axis=1)  # the coordinate that comes to zero first
            until = until[np.arange(len(rows)), corner]
            left = stops[rows, stop] - way
            stopping = left <= until
            length = np.where(stopping, left, until)
            weights = np.clip(weights + length[:, None] * rate, 0, 1)
            way = way + length
            crossing = np.flatnonzero(~stopping)
            half = 3 * face[crossing] + (corner[crossing] + 1) % 3
            other = self.opposite[half]
            going = np.ones(len(rows), dtype=bool)
            going[crossing[other < 0]] = False
            if (other < 0).any():
                crossing, half, other = (x[other >= 0] for x in (crossing, half, other))
            self._cross(crossing, half, other, face, weights, direction, sign)
            at_stop = np.flatnonzero(stopping)
            normals = sign[at_stop, None] * self.normals_at(face[at_stop], weights.take(at_stop, axis=0))
            found[rows[at_stop], stop[at_stop]] = normals
            stop = stop + stopping
            going &= stop < stops.shape[1]
            kept = np.flatnonzero(going)  # taking by number is several times as fast as by a mask
            arrays: list[np.ndarray] = [rows, face, weights, direction, way, stop, sign]
            rows, face, weights, direction, way, stop, sign = (x.take(kept, axis=0) for x in arrays)
            if not len(rows):
                break
        return found

    def _cross(
        self,
        rows: np.ndarray,
        half: np.ndarray,
        other: np.ndarray,
        face: np.ndarray,
        weights: np.ndarray,
        direction: np.ndarray,
        sign: np.ndarray,
    ) -> None:
        """Take walkers ``rows`` from one half-edge to the one on its other side; the arrays are changed."""
        along, inwards = self.half_edges
        corner, k, m = face[rows], half % 3, other % 3
        left_along = along.take(half, axis=0)
        sideways = np.einsum("ni,ni->n", direction.take(rows, axis=0), left_along)
        ahead = np.sqrt(np.maximum(1 - sideways**2, 0))
        direction[rows] = sideways[:, None] * left_along + ahead[:, None] * inwards.take(other, axis=0)
        at_start, at_end = weights[rows, k], weights[rows, (k + 1) % 3]
        face[rows] = other // 3
        same_way = self.faces[corner, k] == self.faces[face[rows], m]
        weights[rows] = 0
        total = np.maximum(at_start + at_end, 1e-300)
        weights[rows, m] = np.where(same_way, at_start, at_end) / total
        weights[rows, (m + 1) % 3] = np.where(same_way, at_end, at_start) / total
        sign[rows] *= np.where(same_way, -1.0, 1.0)
