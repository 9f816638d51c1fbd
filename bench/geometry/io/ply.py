"""PLY, read and written so that nothing is lost: float64 coordinates, and every count of the header is kept.

The readers at hand are not strict enough for a benchmark: an ASCII file that ends early loses faces without a word, and
writers round coordinates to float32, which at a distance of 1e6 from the origin is a sixteenth of a unit.
"""

from __future__ import annotations

import re

import numpy as np

from ...errors import BadInput
from ...notices import notice
from .ply_tables import AsciiSource, BinarySource, Columns, Element, Property, Ragged
from .polygons import triangulate
from .raw import NO_FACES, RawGeometry

# fmt: off
TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "double": "f8", "float64": "f8",
}
# fmt: on
WHOLE = {word for word, kind in TYPES.items() if kind[0] in "iu"}
EXPECTED = "expected a PLY file (ascii or binary, version 1.0)"


def read_ply(data: bytes, name: str) -> RawGeometry:
    """The vertices, faces, normals and colours in the content of a PLY file; ``name`` stands in messages.

    Raises
    ------
    BadInput
        If it is no PLY file, or ends before all that its header promises.
    """
    form, elements, body = _header(data, name)
    source = AsciiSource(body, name) if form == "ascii" else BinarySource(body, name, "<" if "little" in form else ">")
    tables = {element.name: source.table(element) for element in elements}
    if source.left_over():
        notice(f"{name}: there is more in the file than its header says; the rest is ignored")
    vertex = tables.get("vertex", {})
    if any(axis not in vertex for axis in "xyz"):
        raise BadInput(f"{name}: its header names no vertices with x, y and z; {EXPECTED} of a mesh or point cloud")
    vertices = _stack(vertex, "x", "y", "z")
    if tables.get("tristrips"):
        raise BadInput(f"{name}: holds triangle strips; expected faces. Convert it, for instance with MeshLab")
    face = tables.get("face", {})
    polygons = face.get("vertex_indices", face.get("vertex_index"))
    if polygons is not None and not isinstance(polygons, Ragged):
        raise BadInput(f"{name}: the vertex indices of its faces are no list; {EXPECTED}")
    faces = triangulate(*polygons, vertices, name) if polygons else NO_FACES
    return RawGeometry(vertices, faces, _stack(vertex, "nx", "ny", "nz"), _colors(vertex))


def write_ply(raw: RawGeometry) -> bytes:
    """The content of a binary PLY file: coordinates and normals as double, colours as uchar."""
    columns = [("x", "f8"), ("y", "f8"), ("z", "f8")]
    blocks = [raw.vertices]
    if raw.normals is not None:
        columns += [("nx", "f8"), ("ny", "f8"), ("nz", "f8")]
        blocks.append(raw.normals)
    if raw.colors is not None:
        columns += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
        blocks.append(np.rint(np.clip(raw.colors, 0, 1) * 255))
    table = np.empty(len(raw.vertices), dtype=[(column, "<" + kind) for column, kind in columns])
    for (column, _), values in zip(columns, np.concatenate(blocks, axis=1).T, strict=True):
        table[column] = values
    words = {"f8": "double", "u1": "uchar"}
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    header += [f"property {words[kind]} {column}" for column, kind in columns]
    faces = np.empty(len(raw.faces), dtype=[("size", "u1"), ("corners", "<i4", 3)])
    faces["size"], faces["corners"] = 3, raw.faces
    if len(faces):
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    return "\n".join([*header, "end_header", ""]).encode("ascii") + table.tobytes() + faces.tobytes()


# -- the header --------------------------------------------------------------------------------------------------------


def _header(data: bytes, name: str) -> tuple[str, list[Element], bytes]:
    if data[:3] != b"ply":
        raise BadInput(f"{name}: does not begin with 'ply'; {EXPECTED}")
    end = data.find(b"end_header")
    if end < 0:
        raise BadInput(f"{name}: its header has no end; {EXPECTED}. The file is cut off or damaged")
    newline = data.find(b"\n", end)
    body = data[newline + 1 :] if newline >= 0 else b""
    form, elements = "", []
    for line in data[:end].decode("latin-1").splitlines()[1:]:
        match line.split():
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as form, *_]:
                pass
            case ["element", title, count] if re.fullmatch("[0-9]{1,18}", count):
                elements.append(Element(title, int(count), []))
            case ["property", "list", length, kind, title] if length in WHOLE and kind in TYPES and elements:
                elements[-1].properties.append(Property(title, TYPES[kind], TYPES[length]))
            case ["property", kind, title] if kind in TYPES and elements:
                elements[-1].properties.append(Property(title, TYPES[kind]))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise BadInput(f"{name}: cannot read the line {line.strip()[:60]!r} of its header; {EXPECTED}")
    if not form or any(not element.properties for element in elements):
        raise BadInput(f"{name}: its header names no format, or an element without properties; {EXPECTED}")
    _check_names([element.name for element in elements], "elements", name)
    for element in elements:
        _check_names([prop.name for prop in element.properties], f"properties of {element.name!r}", name)
    return form, elements, body


def _check_names(names: list[str], what: str, name: str) -> None:
    if len(set(names)) < len(names):
        twice = next(one for one in names if names.count(one) > 1)
        raise BadInput(f"{name}: its header has two {what} called {twice!r}; expected different names. It is damaged")


# -- columns ----------------------------------------------------------------------------------------------------------


def _stack(vertex: Columns, *names: str) -> np.ndarray | None:
    if any(name not in vertex or isinstance(vertex[name], Ragged) for name in names):
        return None
    return np.stack([vertex[name] for name in names], axis=1).astype(np.float64)


def _colors(vertex: Columns) -> np.ndarray | None:
    colors = _stack(vertex, "red", "green", "blue")
    if colors is None:
        return None
    kind = np.asarray(vertex["red"]).dtype
    return colors / np.iinfo(kind).max if kind.kind in "ui" else colors
