"""Wavefront OBJ and OFF, read as surfaces: one vertex stays one vertex, whatever texture seams run through it."""

from __future__ import annotations

import numpy as np

from ...errors import BadInput
from .polygons import triangulate
from .raw import NO_FACES, RawGeometry


def read_obj(data: bytes, name: str) -> RawGeometry:
    """Vertices, polygons and, where one belongs to each vertex, normals and colours of an OBJ file.

    Raises
    ------
    BadInput
        With the number of the line that is no OBJ, or names a vertex that does not exist.
    """
    vertices: list[list[float]] = []
    normals: list[list[float]] = []
    polygons: list[list[str]] = []
    counts: list[tuple[int, int]] = []  # how many v and vn stood above each face: negative indices count back from it
    text = data.decode("utf-8", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(text.splitlines(), 1):
        words = _words(line)
        if not words:
            continue
        keyword, values = words[0], words[1:]
        try:
            if keyword == "v":
                vertices.append(_floats(values, at_least=3))
            elif keyword == "vn":
                normals.append(_floats(values, at_least=3)[:3])
            elif keyword in ("f", "fo"):
                if len(values) < 3:
                    raise ValueError("a face of fewer than 3 corners")
                polygons.append(values)
                counts.append((len(vertices), len(normals)))
        except ValueError as error:
            raise BadInput(f"{name}: line {number}: {error}; expected a Wavefront OBJ file") from None
    if not vertices:
        raise BadInput(f"{name}: holds no vertices; expected a Wavefront OBJ file with lines 'v x y z' and 'f 1 2 3'")
    points = np.array([vertex[:3] for vertex in vertices])
    faces, per_vertex = _obj_faces(polygons, counts, points, np.array(normals).reshape(-1, 3), name)
    colors = np.array([vertex[3:6] for vertex in vertices]) if all(len(v) == 6 for v in vertices) else None
    return RawGeometry(points, faces, per_vertex, colors)


def _obj_faces(
    polygons: list[list[str]], counts: list[tuple[int, int]], points: np.ndarray, normals: np.ndarray, name: str
) -> tuple[np.ndarray, np.ndarray | None]:
    """Triangles, and the normal of each vertex if the file gives every vertex exactly one."""
    vertices = len(points)
    if not polygons:
        return NO_FACES, normals if len(normals) == vertices else None
    sizes = np.array([len(polygon) for polygon in polygons])
    corners = [corner.split("/") for polygon in polygons for corner in polygon]
    above = np.repeat(np.array(counts), sizes, axis=0)
    try:
        index = np.array([int(corner[0]) for corner in corners], dtype=np.int64)
        of_normal = np.array([int(corner[2] or 0) if len(corner) > 2 else 0 for corner in corners], dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise BadInput(f"{name}: a face has a corner that is no number: {error}; expected 'f 1 2 3'") from None
    index = np.where(index < 0, above[:, 0] + index, index - 1)
    faces = triangulate(sizes, index, points, name)
    of_normal = np.where(of_normal < 0, above[:, 1] + of_normal, of_normal - 1)
    if not len(normals) or (of_normal < 0).any() or (of_normal >= len(normals)).any():
        return faces, None
    per_vertex = np.full((vertices, 3), np.nan)
    per_vertex[index] = normals[of_normal]
    is_one = np.isfinite(per_vertex).all() and (per_vertex[index] == normals[of_normal]).all()
    return faces, per_vertex if is_one else None


def read_off(data: bytes, name: str) -> RawGeometry:
    """Vertices and polygons of an OFF file (also COFF, NOFF, STOFF: what they hold besides is not read).

    Raises
    ------
    BadInput
        If it does not begin with OFF, or holds fewer vertices or faces than it promises.
    """
    expected = "expected an OFF file: 'OFF', then the numbers of vertices, faces and edges, then one a line"
    lines = [words for line in data.decode("utf-8", errors="replace").splitlines() if (words := _words(line))]
    if not lines or not lines[0][0].upper().endswith("OFF"):
        raise BadInput(f"{name}: does not begin with 'OFF'; {expected}")
    if lines[0][1:2] and lines[0][1].upper() == "BINARY":
        raise BadInput(f"{name}: is a binary OFF file, which is not supported; convert it to PLY")
    head = lines[0][1:]
    lines = lines[1:]
    if not head and lines:
        head, lines = lines[0], lines[1:]
    try:
        vertices, polygons = int(head[0]), int(head[1])
        if len(lines) < vertices + polygons or vertices < 0 or polygons < 0:
            raise BadInput(
                f"{name}: ends early: it promises {vertices} vertices and {polygons} faces, but has {len(lines)} "
                "lines for them. The file is cut off; copy or export it again"
            )
        points = np.array([_floats(words[:3], at_least=3) for words in lines[:vertices]]).reshape(-1, 3)
        rows = [_polygon(words) for words in lines[vertices : vertices + polygons]]
        corners = np.array([corner for row in rows for corner in row], dtype=np.int64)
    except (ValueError, IndexError, OverflowError) as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput(f"{name}: {error}; {expected}") from None
    sizes = np.array([len(row) for row in rows], dtype=np.int64)
    return RawGeometry(points, triangulate(sizes, corners, points, name))


def _words(line: str) -> list[str]:
    return (line.partition("#")[0] if "#" in line else line).split()


def _floats(words: list[str], *, at_least: int) -> list[float]:
    if len(words) < at_least:
        raise ValueError(f"{len(words)} numbers where {at_least} belong")
    return list(map(float, words))


def _polygon(words: list[str]) -> list[int]:
    size = int(words[0])
    if size < 0 or len(words) < size + 1:
        raise ValueError(f"a face of {size} corners names only {len(words) - 1}")
    return list(map(int, words[1 : size + 1]))
