"""PLY, read and written so that nothing is lost: float64 coordinates, and every count of the header is kept.

The readers at hand are not strict enough for a benchmark: an ASCII file that ends early loses faces without a word, and
writers round coordinates to float32, which at a distance of 1e6 from the origin is a sixteenth of a unit.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np

from ..errors import BadInput
from .raw import NO_FACES, RawGeometry, triangulate

# fmt: off
TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "float64": "f8",
}
# fmt: on
EXPECTED = "expected a PLY file (ascii or binary, version 1.0)"


class Property(NamedTuple):
    """One column, or a list when ``length`` says how its length is stored."""

    name: str
    type: str
    length: str = ""


class Element(NamedTuple):
    """One table of the file."""

    name: str
    count: int
    properties: list[Property]


class Ragged(NamedTuple):
    """A column of lists: their sizes (n,), and all values one after the other."""

    sizes: np.ndarray
    values: np.ndarray


Columns = dict[str, "np.ndarray | Ragged"]


def read_ply(data: bytes, name: str) -> RawGeometry:
    """The vertices, faces, normals and colours in the content of a PLY file; ``name`` stands in messages.

    Raises
    ------
    BadInput
        If it is no PLY file, or ends before all that its header promises.
    """
    form, elements, body = _header(data, name)
    source = _Ascii(body, name) if form == "ascii" else _Binary(body, name, "<" if "little" in form else ">")
    tables = {element.name: source.table(element) for element in elements}
    if source.left_over():
        warnings.warn(f"{name}: there is more in the file than its header says; the rest is ignored", stacklevel=3)
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
    faces = triangulate(polygons.sizes, polygons.values.astype(np.int64), len(vertices), name) if polygons else NO_FACES
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
            case ["element", title, count] if count.isdigit():
                elements.append(Element(title, int(count), []))
            case ["property", "list", length, kind, title] if length in TYPES and kind in TYPES and elements:
                elements[-1].properties.append(Property(title, TYPES[kind], TYPES[length]))
            case ["property", kind, title] if kind in TYPES and elements:
                elements[-1].properties.append(Property(title, TYPES[kind]))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise BadInput(f"{name}: cannot read the line {line.strip()[:60]!r} of its header; {EXPECTED}")
    if not form or any(not element.properties for element in elements):
        raise BadInput(f"{name}: its header names no format, or an element without properties; {EXPECTED}")
    return form, elements, body


# -- the tables --------------------------------------------------------------------------------------------------------


class _Source:
    """Reads one table after the other; the two formats differ in how a run of equal rows is read."""

    def __init__(self, name: str):
        self.name, self.at = name, 0

    def run(self, element: Element, sizes: list[int], count: int) -> np.ndarray | None:
        """Up to ``count`` rows whose lists have these sizes, as a structured array; None where the file ends."""
        raise NotImplementedError

    def skip(self, element: Element, sizes: list[int], rows: int) -> None:
        """Move past ``rows`` such rows."""
        raise NotImplementedError

    def sizes_of_row(self, element: Element) -> list[int] | None:
        """The sizes of the lists in the row that comes next."""
        raise NotImplementedError

    def table(self, element: Element) -> Columns:
        """One table, read in runs of rows that are laid out alike (mostly the whole table is one)."""
        parts: list[np.ndarray] = []
        done, guess = 0, element.count
        while done < element.count:
            sizes = self.sizes_of_row(element)
            rows = None if sizes is None else self.run(element, sizes, min(guess, element.count - done))
            if rows is None or not len(rows):
                raise BadInput(
                    f"{self.name}: ends early: its header promises {element.count} of {element.name!r}, "
                    f"{done} are there. The file is cut off; copy or export it again"
                )
            same = np.ones(len(rows), dtype=bool)
            for title, size in zip(_lists(element), sizes or (), strict=True):
                same &= rows[f"size of {title}"] == size
            length = len(rows) if same.all() else int(same.argmin())
            # After a short run the next is probably short too; reading far ahead each time would cost a square.
            guess = 4 * length if length < len(rows) else element.count
            parts.append(rows[:length])
            self.skip(element, sizes or [], length)
            done += length
        return _columns(element, parts)


class _Binary(_Source):
    def __init__(self, body: bytes, name: str, order: str):
        super().__init__(name)
        self.body, self.order = body, order

    def sizes_of_row(self, element: Element) -> list[int] | None:
        sizes, at = [], self.at
        for prop in element.properties:
            if prop.length:
                kind = np.dtype(self.order + prop.length)
                if at + kind.itemsize > len(self.body):
                    return None
                size = int(np.frombuffer(self.body, kind, 1, at)[0])
                if size < 0:
                    return None
                sizes.append(size)
                at += kind.itemsize + size * np.dtype(prop.type).itemsize
            else:
                at += np.dtype(prop.type).itemsize
        return sizes if at <= len(self.body) else None

    def run(self, element: Element, sizes: list[int], count: int) -> np.ndarray | None:
        kind = _row_type(element, sizes, self.order)
        there = (len(self.body) - self.at) // kind.itemsize
        return np.frombuffer(self.body, kind, min(count, there), self.at) if there > 0 else None

    def skip(self, element: Element, sizes: list[int], rows: int) -> None:
        self.at += rows * _row_type(element, sizes, self.order).itemsize

    def left_over(self) -> bool:
        return bool(self.body[self.at :].strip())


class _Ascii(_Source):
    def __init__(self, body: bytes, name: str):
        super().__init__(name)
        try:
            self.values = np.array(body.split(), dtype=np.float64)
        except ValueError as error:
            raise BadInput(f"{name}: {error}; {EXPECTED}. The file is cut off or damaged") from None

    def sizes_of_row(self, element: Element) -> list[int] | None:
        sizes, at = [], self.at
        for prop in element.properties:
            if prop.length:
                if at >= len(self.values) or not 0 <= self.values[at] < 2**31:
                    return None
                sizes.append(int(self.values[at]))
                at += sizes[-1]
            at += 1
        return sizes if at <= len(self.values) else None

    def run(self, element: Element, sizes: list[int], count: int) -> np.ndarray | None:
        width = len(element.properties) + sum(sizes)
        rows = min(count, (len(self.values) - self.at) // width)
        block = self.values[self.at : self.at + rows * width].reshape(rows, width)
        # Every number of the row as float64: the same fields as in a binary file.
        kind = _row_type(element, sizes, "=", everything="f8")
        return np.ascontiguousarray(block).view(kind)[:, 0] if rows else None

    def skip(self, element: Element, sizes: list[int], rows: int) -> None:
        self.at += rows * (len(element.properties) + sum(sizes))

    def left_over(self) -> bool:
        return self.at < len(self.values)


def _lists(element: Element) -> list[str]:
    return [prop.name for prop in element.properties if prop.length]


def _row_type(element: Element, sizes: list[int], order: str, everything: str = "") -> np.dtype:
    fields: list[tuple] = []
    remaining = iter(sizes)
    for prop in element.properties:
        kind = order + (everything or prop.type)
        if prop.length:
            fields.append((f"size of {prop.name}", order + (everything or prop.length)))
            fields.append((prop.name, kind, (next(remaining),)))
        else:
            fields.append((prop.name, kind))
    return np.dtype(fields)


def _columns(element: Element, parts: list[np.ndarray]) -> Columns:
    columns: Columns = {}
    for prop in element.properties:
        if prop.length:
            sizes = [np.full(len(rows), rows[prop.name].shape[1], dtype=np.int64) for rows in parts]
            values = [rows[prop.name].ravel() for rows in parts]
            columns[prop.name] = Ragged(_join(sizes, "i8"), _join(values, prop.type))
        else:
            columns[prop.name] = _join([rows[prop.name] for rows in parts], prop.type)
    return columns


def _join(parts: list[np.ndarray], kind: str) -> np.ndarray:
    kind = "f8" if kind in ("f4", "f8") else kind  # an ASCII file may hold more digits than the type that it names
    with np.errstate(invalid="ignore"):  # NaN as an index becomes one that names no vertex
        return np.concatenate(parts).astype(kind) if parts else np.empty(0, dtype=kind)


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
