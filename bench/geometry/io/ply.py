"""PLY, read and written so that nothing is lost: float64 coordinates, and every count of the header is checked.

Existing readers are not strict enough for a benchmark: an ASCII file that ends early silently loses faces, and
writers round coordinates to float32, which at a distance of 1e6 from the origin is a sixteenth of a unit.
"""

from __future__ import annotations

import re

import numpy as np

from ...errors import BadInput
from ...notices import notice
from .colors import colors_of
from .columns import names_for, smallest_float
from .plain import decoded, first_word_that_is_no_number, numbers, plain_text, words_of
from .ply_tables import BinarySource, Columns, Element, NumberSource, Property, Ragged
from .polygons import triangulate
from .raw import NO_FACES, RawGeometry
from .strips import triangles_of_strips

# fmt: off
TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "double": "f8", "float64": "f8", "int64": "i8", "uint64": "u8",
}
# fmt: on
WHOLE = {word for word, kind in TYPES.items() if kind[0] in "iu"}
EXPECTED = "expected a PLY file (ascii or binary, version 1.0)"

# The names of the parts of a vertex, in small letters: the first complete one is taken.
PLACES = [tuple(before + axis for axis in "xyz") for before in ("", "pos_", "position_", "p", "pos", "vertex_")]
NORMALS = [
    *(tuple(before + axis for axis in "xyz") for before in ("n", "normal_", "normal", "n_", "norm_", "nrm_", "vn")),
    ("nxx", "nyy", "nzz"),
]
COLORS = [
    tuple(before + channel for channel in channels)
    for before in ("", "diffuse_", "color_", "colour_", "rgb_", "col_", "c", "vertex_", "ambient_")
    for channels in (("red", "green", "blue"), ("r", "g", "b"))
]
# What faces often have besides, which no reader of surfaces misses.
OF_FACES = {"red", "green", "blue", "alpha", "nx", "ny", "nz", "texcoord", "texnumber", "flags", "quality"}
VERTICES, FACES = ("vertex", "vertices", "point", "points"), ("face", "faces")
INDICES = ("vertex_indices", "vertex_index", "vertex_indexes", "vertices", "indices")


def read_ply(data: bytes, name: str) -> RawGeometry:
    """The vertices, faces (also triangle strips), normals, colours and scalars in the content of a PLY file.

    ``name`` is for messages. Numbers of vertices that are neither place nor normal nor colour are scalars. A notice
    names what else there is.

    Raises
    ------
    BadInput
        If it is no PLY file, or ends before all that its header promises.
    """
    data = decoded(data)
    form, elements, at = _header(data, name)
    tables = _tables(data, at, form, elements, name)
    vertex = next((tables.pop(title) for title in VERTICES if title in tables), {})
    vertices = _taken(vertex, PLACES)
    if vertices is None:
        raise BadInput(f"{name}: its header names no vertices with x, y and z; {EXPECTED} of a mesh or point cloud")
    face = next((tables.pop(title) for title in FACES if title in tables), {})
    polygons = _indices(face, name)
    faces = triangulate(*polygons, vertices, name) if polygons else NO_FACES
    strips = _indices(tables.pop("tristrips", {}), name)
    if strips:
        faces = np.concatenate([faces, triangles_of_strips(*strips, len(vertices), name)])
    normals, colors = _taken(vertex, NORMALS), _colors(vertex)
    scalars = {title: np.asarray(vertex.pop(title), dtype=np.float64) for title in _plain_columns(vertex)}
    _name_the_rest(vertex, face, tables, name)
    return RawGeometry(vertices, faces, normals, colors, scalars or None)


def write_ply(raw: RawGeometry) -> bytes:
    """The content of a binary PLY file: coordinates and normals as double, colours as uchar.

    Scalars are properties of their names: float if that preserves them, otherwise double.
    """
    columns = [("x", "f8"), ("y", "f8"), ("z", "f8")]
    blocks = [raw.vertices]
    if raw.normals is not None:
        columns += [("nx", "f8"), ("ny", "f8"), ("nz", "f8")]
        blocks.append(raw.normals)
    if raw.colors is not None:
        columns += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
        blocks.append(np.rint(np.clip(raw.colors, 0, 1) * 255))
    if raw.scalars:
        names = names_for(raw.scalars, [column for column, _ in columns])
        columns += zip(names, map(smallest_float, raw.scalars.values()), strict=True)
        blocks.append(np.stack(list(raw.scalars.values()), axis=1))
    table = np.empty(len(raw.vertices), dtype=[(column, "<" + kind) for column, kind in columns])
    for (column, _), values in zip(columns, np.concatenate(blocks, axis=1).T, strict=True):
        table[column] = values
    words = {"f4": "float", "f8": "double", "u1": "uchar"}
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    header += [f"property {words[kind]} {column}" for column, kind in columns]
    faces = np.empty(len(raw.faces), dtype=[("size", "u1"), ("corners", "<i4", 3)])
    faces["size"], faces["corners"] = 3, raw.faces
    if len(faces):
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    return "\n".join([*header, "end_header", ""]).encode("ascii") + table.tobytes() + faces.tobytes()


# -- the header --------------------------------------------------------------------------------------------------------


def _header(data: bytes, name: str) -> tuple[str, list[Element], int]:
    """The form, the elements, and where the header has ended."""
    if data[:3] != b"ply":
        raise BadInput(f"{name}: does not begin with 'ply'; {EXPECTED}")
    end = re.search(rb"[\r\n][ \t]*end_header[ \t]*", data)
    if not end:
        raise BadInput(f"{name}: its header has no end; {EXPECTED}. The file is cut off or damaged")
    # A header whose lines end with CR is followed by data that may begin with what is LF elsewhere.
    line_end = re.compile(rb"\r" if b"\n" not in data[: end.end()] else rb"\r?\n").match(data, end.end())
    form, elements = "", []
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        match line.split():
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as form, *_]:
                pass
            case ["element", title, count] if re.fullmatch("[0-9]{1,18}", count):
                elements.append(Element(title.lower(), int(count), []))
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
    if any(e.name in VERTICES and any(p.length and p.name in INDICES[:3] for p in e.properties) for e in elements):
        raise BadInput(f"{name}: its header has no line 'element face' before the list of vertex indices; {EXPECTED}")
    for element in elements:
        _check_names([prop.name for prop in element.properties], f"properties of {element.name!r}", name)
    return form, elements, line_end.end() if line_end else end.end()


def _check_names(names: list[str], what: str, name: str) -> None:
    if len(set(names)) < len(names):
        twice = next(one for one in names if names.count(one) > 1)
        raise BadInput(f"{name}: its header has two {what} called {twice!r}; expected different names. It is damaged")


# -- the tables --------------------------------------------------------------------------------------------------------


def _tables(data: bytes, at: int, form: str, elements: list[Element], name: str) -> dict[str, Columns]:
    if form != "ascii":
        source = BinarySource(data, name, "<" if "little" in form else ">", at)
        tables = {element.name: source.table(element) for element in elements}
        whole = not source.left_over()
    else:
        tables, whole = _of_text(data[at:], elements, name)
    if not whole:
        notice(f"{name}: there is more in the file than its header says; the rest is ignored")
    return tables


def _of_text(body: bytes, elements: list[Element], name: str) -> tuple[dict[str, Columns], bool]:
    """The tables of an ASCII file, and whether they are all that is in it.

    A number's meaning follows from its place among all numbers. Some writers give a row more numbers than declared:
    where that comes out wrong and there are as many lines as rows, each line is a row.
    """
    try:
        source = NumberSource(numbers(body), name)
    except ValueError:
        wrong = first_word_that_is_no_number(body)
        raise BadInput(
            f"{name}: holds {wrong!r} instead of a number; expected the numbers of a PLY file. The file is cut off "
            "or damaged"
        ) from None
    tables: dict[str, Columns] = {}
    fault = None
    try:
        tables = {element.name: source.table(element) for element in elements}
        if not source.left_over():
            return tables, True
    except BadInput as error:
        fault = error
    by_lines = _by_lines(source, body, elements)
    if by_lines:
        notice(f"{name}: has rows of more numbers than its header says; each line is read as a row without the rest")
        return by_lines, True
    if fault:
        raise fault
    return tables, False


def _by_lines(source: NumberSource, body: bytes, elements: list[Element]) -> dict[str, Columns]:
    """The tables if each row has a line of its own, or nothing."""
    per_line = words_of(plain_text(body)).per_line
    ends = np.cumsum(per_line)[per_line > 0]
    if len(ends) != sum(element.count for element in elements) or ends[-1] != len(source.cells):
        return {}
    starts, tables, line = np.concatenate([[0], ends[:-1]]), {}, 0
    for element in elements:
        own = slice(line, line := line + element.count)
        columns = source.rows(element, starts[own], ends[own])
        if columns is None:
            return {}
        tables[element.name] = columns
    return tables


# -- columns -----------------------------------------------------------------------------------------------------------


def _plain_columns(columns: Columns) -> list[str]:
    return [title for title, column in columns.items() if not isinstance(column, Ragged)]


def _taken(vertex: Columns, choices: list[tuple[str, ...]]) -> np.ndarray | None:
    """Three columns, out of ``vertex``, as (v, 3) float64: those of the first choice that is there."""
    titles = {title.lower(): title for title in _plain_columns(vertex)}
    for choice in choices:
        if all(title in titles for title in choice):
            stacked = np.empty((len(vertex[titles[choice[0]]]), 3))
            for k, title in enumerate(choice):
                stacked[:, k] = vertex.pop(titles[title])
            return stacked
    return None


def _colors(vertex: Columns) -> np.ndarray | None:
    kinds = {title: column.dtype.kind for title, column in vertex.items() if not isinstance(column, Ragged)}
    colors = _taken(vertex, COLORS)
    if colors is None:
        return None
    taken = kinds.keys() - vertex.keys()
    return colors_of(colors, integers=all(kinds[title] in "ui" for title in taken))


def _indices(face: Columns, name: str) -> Ragged | None:
    """The vertex indices of faces or strips, out of ``face``."""
    if not face:
        return None
    lists = [title for title in face if title in INDICES]
    lists = lists or [title for title, column in face.items() if isinstance(column, Ragged)]
    found = face.pop(lists[0]) if lists else None
    if found is not None and not isinstance(found, Ragged):
        raise BadInput(f"{name}: the vertex indices of its faces are not a list; {EXPECTED}")
    return found


def _name_the_rest(vertex: Columns, face: Columns, others: dict[str, Columns], name: str) -> None:
    """Report the parts of the file that are not read, except for properties that faces often have."""
    rest = [f"{title} of vertices" for title in vertex]
    rest += [f"{title} of faces" for title in face if title.lower() not in OF_FACES]
    rest += [f"element {title}" for title, columns in others.items() if any(map(_length, columns.values()))]
    if rest:
        notice(f"{name}: not read from it: {', '.join(rest)}")


def _length(column: np.ndarray | Ragged) -> int:
    return len(column.sizes if isinstance(column, Ragged) else column)
