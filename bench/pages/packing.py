"""Shapes as small byte strings for a page: 16 bits a coordinate, 8 bits an error, compressed.

The page decodes them with the browser's ``DecompressionStream``, and neither side needs a library: of the
Python packages of meshoptimizer one is a source archive in an alpha version, the others are new or have no wheel for
some of our versions of Python; Draco's decoder would be WebAssembly in each page. Measured on reconstructed surfaces: 8
bytes a vertex, with its faces and its error, of meshes with 8,000 faces, and 6 of those with 100,000.

The container, all numbers little-endian::

    "dtbs"  uint32 version (1)  zlib stream of:
        uint32 flags (1 faces, 2 errors, 4 normals), vertices n, faces m, roots r
        float32 x, y, z of the lowest corner, and the length of a step
        3 times n bytes low, n bytes high    positions, see below: x, then y, then z
        n bytes                              errors, where flagged
        2 times n bytes                      normals, where flagged: octahedral (Cigolle et al. 2014), -1..1 as 0..254
        faces, where flagged:
            m - r bytes low, high, highest      steps from one parent to the next, modulo 2^24
            m - r bytes                         edges 0..5 of the parents
            m + 2 r bytes low, high, highest    codes of corners

Faces are a breadth-first walk from neighbour to neighbour. The first r start a component each and have three corners.
Each of the others stands on an edge of an earlier face, its parent: edge k of a face (a, b, c) is (a, b), (b, c) or
(c, a). It has that edge backwards and then a new corner; edges 3 to 5 are the same in their own direction, of a
neighbour that faces the other way. A corner's code is 0 for a vertex that has not been used, otherwise how many
vertices lie between it and the newest, plus 1.

Vertices are numbered as faces use them. The stored position is the difference to a prediction, modulo 65536, with its
sign in the lowest bit (0, -1, 1, -2 are 0, 1, 2, 3): the fourth corner of the parallelogram with the parent; of the
first faces, and in clouds, the vertex before. An error is the difference to the mean of the edge's two, rounded up, or
to the error before, modulo 256. Points of a cloud follow a Morton curve.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np

MAGIC, VERSION = b"dtbs", 1
FACES, ERRORS, NORMALS = 1, 2, 4
STEPS = 65535  # of the longest side of the bounding box
WORST = 255  # the error at the limit of the scale, and of all beyond


@dataclass(frozen=True, eq=False)
class PackedShape:
    """The content of a container: a mesh, or a cloud if ``faces`` is None."""

    low: np.ndarray
    """(3,) float32 array: the lowest corner of the bounding box"""
    step: float
    """the length of a step of the positions"""
    positions: np.ndarray
    """(n, 3) uint16 array, in steps from the lowest corner"""
    faces: np.ndarray | None = None
    """(m, 3) int array"""
    errors: np.ndarray | None = None
    """(n,) uint8 array: 0 is on the reference, 255 at the limit or beyond"""
    normals: np.ndarray | None = None
    """(n, 2) uint8 array, octahedral"""

    @property
    def points(self) -> np.ndarray:
        """(n, 3) float64 array: the positions in their unit."""
        return np.float64(self.low) + self.positions * np.float64(self.step)


def quantised(
    points: np.ndarray,
    faces: np.ndarray | None = None,
    errors: np.ndarray | None = None,
    normals: np.ndarray | None = None,
) -> PackedShape:
    """A shape as :func:`pack` stores it: rounded, without unused vertices, in the order of the container.

    Parameters
    ----------
    points : (v, 3) float array
    faces : (m, 3) int array, optional
        Without it the shape is a cloud.
    errors : (v,) float array in 0..1, optional
        Shares of the limit of the scale; what is above 1 counts as 1.
    normals : (v, 3) float array of unit length, optional
    """
    points = np.asarray(points, dtype=np.float64)
    if faces is not None:
        faces, used = _walk(np.asarray(faces, dtype=np.int64), len(points))
        points = points[used]
    low = (points.min(axis=0) if len(points) else np.zeros(3)).astype(np.float32)
    step = np.float32((float(np.ptp(points, axis=0).max()) if len(points) else 0.0) / STEPS or 1.0)
    positions = np.clip(np.rint((points - low) / np.float64(step)), 0, STEPS).astype(np.uint16)
    if faces is None:
        used = np.argsort(_morton(positions), kind="stable")
        positions = positions[used]
    bytes_of_errors = None if errors is None else np.rint(np.clip(errors[used], 0, 1) * WORST).astype(np.uint8)
    return PackedShape(
        low, float(step), positions, faces, bytes_of_errors, None if normals is None else _octahedral(normals[used])
    )


def pack(shape: PackedShape) -> bytes:
    """The container of a shape that :func:`quantised` made."""
    n, m = len(shape.positions), 0 if shape.faces is None else len(shape.faces)
    flags = (
        FACES * (shape.faces is not None) | ERRORS * (shape.errors is not None) | NORMALS * (shape.normals is not None)
    )
    before = np.maximum(np.arange(n) - 1, 0)
    predicted = shape.positions[before].astype(np.int64)
    mean = None if shape.errors is None else shape.errors[before].astype(np.int64)
    tree, roots = [], 0
    if shape.faces is not None and m:
        stored = _Tree(shape.faces)
        roots, tree = stored.roots, stored.streams()
        new, a, b, d = stored.parallelograms()
        corners = shape.positions.astype(np.int64)
        predicted[new] = corners[a] + corners[b] - corners[d]
        if mean is not None and shape.errors is not None:
            mean[new] = (shape.errors[a].astype(np.int64) + shape.errors[b] + 1) // 2
    if n:
        predicted[0] = 0
    difference = (shape.positions - predicted).astype(np.int16).astype(np.int32)
    zigzag = (difference << 1 ^ difference >> 31).astype(np.uint16)
    body = [struct.pack("<4I4f", flags, n, m, roots, *shape.low, shape.step)]
    body += [plane for axis in range(3) for plane in _planes(zigzag[:, axis], 2)]
    if mean is not None and shape.errors is not None:
        if n:
            mean[0] = 0
        body.append((shape.errors - mean).astype(np.uint8).tobytes())
    if shape.normals is not None:
        body += [shape.normals[:, k].tobytes() for k in range(2)]
    return MAGIC + struct.pack("<I", VERSION) + zlib.compress(b"".join([*body, *tree]), 6)


def unpack(data: bytes) -> PackedShape:
    """The shape of a container, as the page decodes it.

    Raises
    ------
    ValueError
        If it is not a container, or of another version.
    """
    if data[:4] != MAGIC or struct.unpack("<I", data[4:8])[0] != VERSION:
        raise ValueError("no packed shape of version 1")
    body = np.frombuffer(zlib.decompress(data[8:]), dtype=np.uint8)
    flags, n, m, roots, *low, step = struct.unpack("<4I4f", body[:32].tobytes())
    stream = _Stream(body, 32)
    zigzag = np.stack([stream.numbers(n, 2) for _ in range(3)], axis=1)
    positions = (zigzag >> 1) ^ -(zigzag & 1)
    errors = stream.numbers(n, 1) if flags & ERRORS else None
    normals = np.stack([stream.numbers(n, 1) for _ in range(2)], axis=1) if flags & NORMALS else None
    faces, gates = _read_faces(stream, m, roots, n) if flags & FACES else (None, {})
    for vertex in range(n):
        a, b, d = gates.get(vertex, (vertex - 1,) * 3)
        if vertex:
            positions[vertex] += positions[a] + positions[b] - positions[d]
            positions[vertex] &= 0xFFFF
            if errors is not None:
                errors[vertex] = errors[vertex] + (errors[a] + errors[b] + 1) // 2 & 0xFF
    return PackedShape(
        np.array(low, np.float32),
        step,
        positions.astype(np.uint16),
        faces,
        None if errors is None else errors.astype(np.uint8),
        None if normals is None else normals.astype(np.uint8),
    )


# -- faces as a tree ---------------------------------------------------------------------------------------------------


def _walk(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The faces (m, 3) in breadth-first order, each turned to begin with the edge that it shares with its parent.

    Returns
    -------
    faces : (m, 3) int array
        Of new numbers: vertices in the order in which faces use them.
    used : (n,) int array
        The old numbers of the new vertices.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    m = len(faces)
    if not m:
        return faces, np.empty(0, dtype=np.int64)
    keys = _edge_keys(faces, count)
    along = np.argsort(keys.ravel(), kind="stable")
    same = np.diff(keys.ravel()[along]) == 0
    left, right = along[:-1][same] // 3, along[1:][same] // 3
    graph = coo_array((np.ones(len(left), np.int8), (left, right)), shape=(m, m)).tocsr()
    _, component = connected_components(graph, directed=False)
    starts = np.unique(component, return_index=True)[1]
    left, right = np.append(left, np.full(len(starts), m)), np.append(right, starts)
    graph = coo_array((np.ones(len(left), np.int8), (left, right)), shape=(m + 1, m + 1)).tocsr()
    order, parents = breadth_first_order(graph, m, directed=False)
    order = order[1:].astype(np.int64)  # without the node that stands before all components
    parent = parents[order].astype(np.int64)
    child = parent < m
    equal = keys[order[child], :, None] == keys[parent[child], None, :]
    first = np.zeros(m, dtype=np.int64)
    first[child] = equal.any(axis=2).argmax(axis=1)
    turned = np.take_along_axis(faces[order], (first[:, None] + np.arange(3)) % 3, axis=1)
    used, at, inverse = np.unique(turned, return_index=True, return_inverse=True)
    rank = np.empty(len(used), dtype=np.int64)
    rank[np.argsort(at)] = np.arange(len(used))
    return rank[inverse.reshape(m, 3)], used[np.argsort(at)]


def _edge_keys(faces: np.ndarray, count: int) -> np.ndarray:
    """(m, 3) int array: a number for each edge, the same in both directions."""
    other = np.roll(faces, -1, axis=1)
    return np.minimum(faces, other) * count + np.maximum(faces, other)


class _Tree:
    """The parents, edges and codes of faces that :func:`_walk` ordered."""

    def __init__(self, faces: np.ndarray):
        self.faces = faces
        m, count = len(faces), int(faces.max()) + 1
        keys = _edge_keys(faces, count)
        # The parent of a face is the first one with its first edge, unless that is the face itself: then it is a root.
        _, at, inverse = np.unique(keys.ravel(), return_index=True, return_inverse=True)
        first = at[inverse.reshape(m, 3)[:, 0]]
        self.parent, self.edge = first // 3, first % 3
        self.roots = int(np.sum(self.parent >= np.arange(m)))

    def streams(self) -> list[bytes]:
        """The faces in the container, plane by plane."""
        r, faces = self.roots, self.faces
        parent, edge = self.parent[r:], self.edge[r:]
        turns = faces[r:, 0] == faces[parent, edge]
        corners = np.concatenate([faces[:r].ravel(), faces[r:, 2]])
        newest = np.maximum.accumulate(np.append(-1, corners))[:-1]
        codes = np.where(corners > newest, 0, newest - corners + 1)
        steps = np.diff(parent, prepend=0)
        return [*_planes(steps, 3), (edge + 3 * turns).astype(np.uint8).tobytes(), *_planes(codes, 3)]

    def parallelograms(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Vertices that are first used as the last corner of a face: they, its edge, and its parent's third corner."""
        r, faces = self.roots, self.faces
        corners = np.concatenate([faces[:r].ravel(), faces[r:, 2]])
        is_new = (corners > np.maximum.accumulate(np.append(-1, corners))[:-1])[3 * r :]
        child = np.flatnonzero(is_new) + r
        third = faces[self.parent[child], (self.edge[child] + 2) % 3]
        return faces[child, 2], faces[child, 0], faces[child, 1], third


def _read_faces(stream: _Stream, m: int, r: int, n: int) -> tuple[np.ndarray, dict[int, tuple[int, int, int]]]:
    """The faces, and for each vertex that a parallelogram predicts its other three corners."""
    parents = (np.cumsum(stream.numbers(m - r, 3)) & 0xFFFFFF).tolist()
    edges = stream.numbers(m - r, 1).tolist()
    codes = iter(stream.numbers(m + 2 * r, 3).tolist())
    newest = -1

    def corner() -> int:
        nonlocal newest
        code = next(codes)
        newest += not code
        return newest - code + 1 if code else newest

    faces = [[corner() for _ in range(3)] for _ in range(r)]
    gates = {}
    for parent, edge in zip(parents, edges, strict=True):
        p = faces[parent]
        a, b, d = p[edge % 3], p[(edge + 1) % 3], p[(edge + 2) % 3]
        if edge < 3:
            a, b = b, a
        before = newest
        last = corner()
        if newest > before:
            gates[last] = (a, b, d)
        faces.append([a, b, last])
    return np.array(faces, dtype=np.int64).reshape(m, 3), gates


# -- bytes -------------------------------------------------------------------------------------------------------------


class _Stream:
    """Reads numbers whose bytes lie in planes: all low bytes, then all high ones."""

    def __init__(self, body: np.ndarray, at: int):
        self.body, self.at = body, at

    def numbers(self, count: int, width: int) -> np.ndarray:
        """The next ``count`` numbers of ``width`` bytes, as an int64 array."""
        planes = self.body[self.at : self.at + count * width].reshape(width, count).astype(np.int64)
        self.at += count * width
        return (planes << 8 * np.arange(width)[:, None]).sum(axis=0)


def _planes(numbers: np.ndarray, width: int) -> list[bytes]:
    return [(numbers.astype(np.int64) >> 8 * k & 0xFF).astype(np.uint8).tobytes() for k in range(width)]


def _morton(positions: np.ndarray) -> np.ndarray:
    """(n,) uint64 array: the bits of the three coordinates (n, 3), interleaved."""
    codes = np.zeros(len(positions), dtype=np.uint64)
    for axis in range(3):
        column = positions[:, axis].astype(np.uint64)
        for bit in range(16):
            codes |= (column >> np.uint64(bit) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return codes


def _octahedral(normals: np.ndarray) -> np.ndarray:
    """(n, 2) uint8 array: unit vectors (n, 3) on the octahedron, its lower half folded outwards."""
    with np.errstate(invalid="ignore", divide="ignore"):
        flat = np.nan_to_num(normals / np.abs(normals).sum(axis=1, keepdims=True))
    xy = flat[:, :2]
    folded = (1 - np.abs(xy[:, ::-1])) * np.where(xy >= 0, 1, -1)
    return np.rint((np.where(flat[:, 2:] < 0, folded, xy) + 1) * 127).astype(np.uint8)
