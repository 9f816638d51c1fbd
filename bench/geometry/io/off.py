"""OFF of all kinds: ``[ST][C][N][4][n]OFF``, by lines or by words, ASCII or binary."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from ...errors import BadInput
from ...notices import notice
from .colors import colors_of
from .plain import first_word_that_is_no_number, numbers, plain_text, without_comments, words_of
from .ply_tables import BinarySource, Columns, Element, NumberSource, Property, Ragged, as_indices
from .polygons import triangulate
from .raw import RawGeometry

EXPECTED = "expected an OFF file: 'OFF', then the numbers of vertices, faces and edges, then one a line"
WORD = re.compile(rb"\s*((?:ST|C|N|4|n)*)OFF(?=[\s\d]|$)", re.IGNORECASE)
BINARY = re.compile(rb"\s*((?:ST|C|N|4|n)*)OFF[ \t]+BINARY[^\n]*\n", re.IGNORECASE)
WIDTHS = {"4": 1, "n": 0, "N": 3, "C": 4, "ST": 2}
FACE = [Property("corners", "i4", "i4")]


class _Tables(NamedTuple):
    """What each vertex has, (v, 3 or more), and the corners of the faces."""

    vertex: np.ndarray
    face: Ragged


def read_off(data: bytes, name: str) -> RawGeometry:
    """Vertices, polygons, and normals and colours of vertices if the letters before ``OFF`` announce them.

    The letters are those of what follows the place of a vertex, the last one first: ``CNOFF`` has normals, then
    colours. Colours of faces, and numbers behind a vertex without a letter for them, are not read.

    Raises
    ------
    BadInput
        If it does not begin with OFF, or holds fewer vertices or faces than it declares.
    """
    binary = BINARY.match(data)
    if binary:
        letters = _letters(binary[1] + b"OFF", name)
        if "n" in letters:
            raise BadInput(f"{name}: is a binary nOFF file; expected one of three dimensions. Convert it to PLY")
        tables = _of_binary(data, binary.end(), letters, name)
    else:
        text = without_comments(plain_text(data))
        word = WORD.match(text)
        if not word and not re.match(rb"\s*\d+\s+\d", text):
            raise BadInput(f"{name}: does not begin with 'OFF'; {EXPECTED}")
        letters = _letters(word[0].strip() if word else b"OFF", name)
        text = text[word.end() if word else 0 :]
        if "n" in letters:
            text = _of_three_dimensions(text, letters, name)
        tables = _of_text(text, letters, bool(word), name)
    points, normals, colors = _parts(tables.vertex, letters, name)
    return RawGeometry(points, triangulate(tables.face.sizes, tables.face.values, points, name), normals, colors)


def _letters(word: bytes, name: str) -> list[str]:
    """The letters of a word before ``OFF``, the last one first, which is the order of their numbers."""
    text = word.decode("ascii")
    # A small n means any dimension, and a large one normals; in a word of small letters it is normals.
    found = re.findall("ST|[CNn4]", text[:-3] if text.endswith("OFF") else text[:-3].upper())[::-1]
    if len(set(found)) < len(found):
        raise BadInput(f"{name}: cannot read the letters of {text!r}; {EXPECTED}")
    return found


def _of_three_dimensions(text: bytes, letters: list[str], name: str) -> bytes:
    """The text of an nOFF file without its first number, which is that of dimensions."""
    three = re.match(rb"\s*3\s", text)
    if not three or "4" in letters:
        raise BadInput(f"{name}: has places of another dimension (nOFF); expected three. Convert it to PLY")
    letters.remove("n")
    return text[three.end() :]


# -- binary ------------------------------------------------------------------------------------------------------------


def _of_binary(data: bytes, at: int, letters: list[str], name: str) -> _Tables:
    source = BinarySource(data, name, ">", at)
    head = source.table(Element("counts", 1, [Property(key, "i4") for key in ("vertices", "faces", "edges")]))
    vertices, faces = int(head["vertices"][0]), int(head["faces"][0])
    if min(vertices, faces) < 0:
        raise BadInput(f"{name}: promises {vertices} vertices and {faces} faces; expected a binary OFF file")
    width = 3 + sum(WIDTHS[letter] for letter in letters)
    columns = source.table(Element("vertex", vertices, [Property(str(k), "f4") for k in range(width)]))
    table = np.stack([columns[str(k)] for k in range(width)], axis=1)
    return _Tables(table, _corners(source.table(Element("face", faces, [*FACE, Property("color", "f4", "i4")]))))


def _corners(columns: Columns) -> Ragged:
    corners = columns["corners"]
    assert isinstance(corners, Ragged)  # FACE is a list
    return corners


# -- text --------------------------------------------------------------------------------------------------------------


def _of_text(text: bytes, letters: list[str], named: bool, name: str) -> _Tables:
    """The tables of a text without its first word.

    A file with one vertex and one face a line is read by lines, which may have more numbers than belong there. In any
    other the lines mean nothing.
    """
    try:
        values = numbers(text)
    except ValueError:
        wrong = first_word_that_is_no_number(text)
        raise BadInput(f"{name}: holds {wrong!r} instead of a number; {EXPECTED}") from None
    per_line = words_of(text).per_line
    per_line = per_line[per_line > 0]
    if len(values) != per_line.sum() or len(values) < 2:
        raise BadInput(f"{name}: does not give the numbers of vertices and faces; {EXPECTED}")
    counts = values[:2]
    if not (np.isfinite(counts).all() and (counts == np.rint(counts)).all() and (counts >= 0).all()):
        raise BadInput(f"{name}: promises {counts[0]:g} vertices and {counts[1]:g} faces; {EXPECTED}")
    vertices, faces = (int(min(count, 1e18)) for count in counts)
    # The number of edges may be missing if the lines show it.
    without_edges = per_line[0] == 2 and (len(per_line) < 2 or per_line[1] >= 3)
    body = 2 if without_edges else 3
    ends = np.cumsum(per_line)
    lines = np.diff(ends[ends > body], prepend=body)
    values = values[body:]
    found = _by_lines(values, lines, vertices, faces) if len(lines) >= vertices + faces else None
    if found and len(lines) == vertices + faces:
        return found
    try:
        by_words, all_read = _by_words(values, vertices, faces, letters, name)
    except BadInput:
        if not found:
            raise
        all_read = False
    if all_read:
        return by_words
    if not found or not named:
        raise BadInput(
            f"{name}: has more numbers than its first line says, or the numbers of a line are not those that belong "
            f"there; {EXPECTED}"
        )
    notice(f"{name}: there is more in the file than its first line says; the rest is ignored")
    return found


def _by_lines(values: np.ndarray, lines: np.ndarray, vertices: int, faces: int) -> _Tables | None:
    """One vertex or face in each line; None if some line has too little in it."""
    starts = np.cumsum(lines) - lines
    at, widths = starts[vertices : vertices + faces], lines[vertices : vertices + faces]
    least = lines[:vertices].min(initial=values.size)
    sizes = values[at]
    if (vertices and least < 3) or not ((sizes >= 0) & (sizes < widths) & (sizes == np.rint(sizes))).all():
        return None
    if vertices and (lines[:vertices] == least).all():
        table = values[: vertices * least].reshape(vertices, least)
    else:  # lines of several lengths: all have a place
        table = values[starts[:vertices, None] + np.arange(3)]
    sizes = sizes.astype(np.int64)
    within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    corners = values[np.repeat(at + 1, sizes) + within]
    return _Tables(table, Ragged(sizes, as_indices(corners)))


def _by_words(values: np.ndarray, vertices: int, faces: int, letters: list[str], name: str) -> tuple[_Tables, bool]:
    """The tables regardless of lines; and whether all words are read."""
    width = 3 + sum(WIDTHS[letter] for letter in letters)
    if len(values) < vertices * width + faces:
        raise BadInput(
            f"{name}: ends early: it promises {vertices} vertices and {faces} faces, but has {len(values)} numbers for "
            "them. The file is cut off; copy or export it again"
        )
    source = NumberSource(values, name, vertices * width)
    face = _corners(source.table(Element("face", faces, FACE)))
    return _Tables(values[: vertices * width].reshape(-1, width), face), not source.left_over()


# -- parts -------------------------------------------------------------------------------------------------------------


def _parts(table: np.ndarray, letters: list[str], name: str) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Places, normals and colours from the numbers of each vertex."""
    points = np.ascontiguousarray(table[:, :3])
    normals = colors = None
    widths = dict(WIDTHS)
    missing = 3 + sum(widths[letter] for letter in letters) - table.shape[1]
    if missing == 1 and "C" in letters:
        widths["C"], missing = 3, 0  # a colour without its opacity
    if missing > 0 and letters:
        notice(f"{name}: its vertices have fewer numbers than {''.join(letters[::-1])}OFF says; only places are read")
        return points, None, None
    if missing < 0:
        notice(f"{name}: its vertices have more numbers than {''.join(letters[::-1])}OFF says; the rest is not read")
    at = 3
    for letter in letters:
        part = table[:, at : at + widths[letter]]
        if letter == "4":
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # a place at infinity is no place
                points = points / part
        elif letter == "N":
            normals = np.ascontiguousarray(part)
        elif letter == "C":
            colors = colors_of(part[:, :3])
        at += widths[letter]
    return points, normals, colors
