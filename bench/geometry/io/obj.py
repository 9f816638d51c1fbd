"""Wavefront OBJ, read as a surface: one vertex stays one vertex, whatever texture seams run through it."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from ...errors import BadInput
from ...notices import notice
from .colors import colors_of
from .plain import numbers, plain_text, without_comments, words_of
from .polygons import triangulate
from .raw import NO_FACES, RawGeometry

CORNER = re.compile(rb"[-+]?\d+(/[-+]?\d*){0,2}")
V, VN, F = 1, 2, 3  # kinds of lines


class _Block(NamedTuple):
    """The lines of one kind without their keywords, and their numbers of words."""

    text: bytes
    words: np.ndarray


class _Fault(ValueError):
    """Some line is no OBJ; which one is looked up by :func:`_complain`."""


def read_obj(data: bytes, name: str) -> RawGeometry:
    """Vertices, polygons and, where one belongs to each vertex, normals and colours of an OBJ file.

    Lines, points and whatever else has no faces are not read. A fourth number of a vertex is a weight, which polygons
    do not have; six or seven numbers are a place and a colour.

    Raises
    ------
    BadInput
        With the number of the line that is not OBJ, or names a vertex that does not exist.
    """
    text = without_comments(plain_text(data)).replace(b"\\\n", b"  ")
    if text.startswith(b" ") or b"\n " in text:
        text = re.sub(rb"^ +", b"", text, flags=re.MULTILINE)
    kinds, text, starts = _kinds(text)
    try:
        vertex, normal, face = (_block(text, starts, kinds == kind) for kind in (V, VN, F))
        if not len(vertex.words):
            raise BadInput(
                f"{name}: holds no vertices; expected a Wavefront OBJ file with lines 'v x y z' and 'f 1 2 3'"
            )
        points, colors = _vertices(vertex, name)
        normals = _columns(_table(normal), normal.words)
        if len(face.words) and face.words[-1] < 3 and kinds[-1] == F and not data.endswith((b"\n", b"\r")):
            raise _Fault
        index, of_normal = _corners(face)
    except _Fault:
        raise _complaint(data, name) from None
    in_order = normals if len(normals) == len(points) else None  # where no face names any
    if not len(face.words):
        return RawGeometry(points, NO_FACES, in_order, colors)
    index = _from_zero(index, kinds, V, face.words)
    faces = triangulate(face.words, index, points, name)
    if of_normal is None:
        return RawGeometry(points, faces, in_order, colors)
    of_normal = _from_zero(of_normal, kinds, VN, face.words)
    return RawGeometry(points, faces, _of_vertices(index, of_normal, normals, len(points)), colors)


# -- lines -------------------------------------------------------------------------------------------------------------


def _kinds(text: bytes) -> tuple[np.ndarray, bytes, np.ndarray]:
    """The kind of each line (0: any other), the text with blanks for keywords, and where its lines begin and end."""
    content = np.frombuffer(text + b"\n\n", dtype=np.uint8).copy()
    starts = np.concatenate([[0], np.flatnonzero(content[:-2] == ord("\n")) + 1])
    first, second, third = (content[starts[:-1] + k] for k in range(3))
    ends_after_one, ends_after_two = (np.isin(after, list(b" \n")) for after in (second, third))
    kinds = np.zeros(len(first), dtype=np.int8)
    kinds[(first == ord("v")) & ends_after_one] = V
    kinds[(first == ord("f")) & ends_after_one] = F
    kinds[(first == ord("v")) & (second == ord("n")) & ends_after_two] = VN
    kinds[(first == ord("f")) & (second == ord("o")) & ends_after_two] = F
    content[starts[:-1][kinds > 0]] = ord(" ")
    two = (kinds > 0) & ~ends_after_one
    content[starts[:-1][two] + 1] = ord(" ")
    return kinds, content[:-2].tobytes(), starts


def _block(text: bytes, starts: np.ndarray, chosen: np.ndarray) -> _Block:
    lines = np.flatnonzero(chosen)
    if not len(lines):
        return _Block(b"", np.empty(0, dtype=np.int64))
    breaks = np.flatnonzero(np.diff(lines) > 1)
    first = starts[lines[np.concatenate([[0], breaks + 1])]]
    after = starts[lines[np.concatenate([breaks, [-1]])] + 1]
    joined = b"".join([text[a:b] for a, b in zip(first.tolist(), after.tolist(), strict=True)])
    return _Block(joined, words_of(joined).per_line)


# -- numbers -----------------------------------------------------------------------------------------------------------


def _numbers(text: bytes, kind: type, count: int) -> np.ndarray:
    try:
        found = numbers(text, kind)
    except ValueError:
        raise _Fault from None
    if len(found) != count:
        raise _Fault
    return found


def _table(block: _Block) -> np.ndarray:
    if len(block.words) and block.words.min() < 3:
        raise _Fault
    return _numbers(block.text, np.float64, int(block.words.sum()))


def _columns(values: np.ndarray, words: np.ndarray, begin: int = 0) -> np.ndarray:
    """Three numbers of each line (lines, 3), from the one at ``begin`` on."""
    if not len(words):
        return np.empty((0, 3))
    if (words == words[0]).all():
        return np.ascontiguousarray(values.reshape(-1, words[0])[:, begin : begin + 3])
    return values[(np.cumsum(words) - words + begin)[:, None] + np.arange(3)]


def _vertices(block: _Block, name: str) -> tuple[np.ndarray, np.ndarray | None]:
    """Places and colours of the lines ``v``."""
    values, words = _table(block), block.words
    points = _columns(values, words)
    colored = (words == 6) | (words == 7)
    if (words == 4).any():
        weights = values[(np.cumsum(words) - 1)[words == 4]]
        if (weights != 1).any():
            notice(f"{name}: {int((weights != 1).sum())} vertices have weights other than 1; weights are not read")
    if not colored.any():
        return points, None
    if not colored.all():
        notice(f"{name}: {int(colored.sum())} of {len(words)} vertices have colours; all colours are left out")
        return points, None
    return points, colors_of(_columns(values, words, 3))


def _corners(block: _Block) -> tuple[np.ndarray, np.ndarray | None]:
    """The numbers of vertices and of normals (0: none) of the corners of all faces, as in the file."""
    text, count = block.text, int(block.words.sum())
    if b"/" not in text:
        return _numbers(text, np.int64, count), None
    text = text.replace(b"//", b"/0/").replace(b"/ ", b"/0 ").replace(b"/\n", b"/0\n")
    if b" /" in text or b"//" in text:
        raise _Fault
    content = np.frombuffer(text, dtype=np.uint8)
    within = (content > ord(" ")) & (content != ord("/"))
    within[1:] &= (content[:-1] <= ord(" ")) | (content[:-1] == ord("/"))
    fields = np.flatnonzero(within)
    values = _numbers(text.replace(b"/", b" "), np.int64, len(fields))
    begins = np.flatnonzero(content[fields - 1] <= ord(" "))  # a blank is where the keyword was
    sizes = np.diff(begins, append=len(fields))
    if len(begins) != count or sizes.max() > 3:
        raise _Fault
    index = values[begins]
    return index, np.where(sizes == 3, values[np.minimum(begins + 2, len(values) - 1)], 0)


def _from_zero(numbers: np.ndarray, kinds: np.ndarray, kind: int, sizes: np.ndarray) -> np.ndarray:
    """Numbers of corners counted from 0; negative ones count back from the line of their face."""
    if numbers.min() >= 0:
        return numbers - 1
    above = np.repeat(np.cumsum(kinds == kind)[kinds == F], sizes)
    return np.where(numbers < 0, above + numbers, numbers - 1)


def _of_vertices(index: np.ndarray, of_normal: np.ndarray, normals: np.ndarray, vertices: int) -> np.ndarray | None:
    """The normal of each vertex if the file gives every vertex exactly one."""
    if not len(normals) or of_normal.min() < 0 or of_normal.max() >= len(normals):
        return None
    per_vertex = np.full((vertices, 3), np.nan)
    own = normals[of_normal]
    per_vertex[index] = own
    return per_vertex if np.isfinite(per_vertex).all() and (per_vertex[index] == own).all() else None


# -- messages ----------------------------------------------------------------------------------------------------------


def _complaint(data: bytes, name: str) -> BadInput:
    """The error about the first line that is not OBJ."""
    lines = plain_text(data).replace(b"\\\n", b"  ").split(b"\n")
    last = next(number for number in range(len(lines), 0, -1) if without_comments(lines[number - 1]).strip())
    for number, line in enumerate(lines, 1):
        wrong = _wrong(without_comments(line).split())
        if not wrong and number == last and line.split()[:1] in ([b"f"], [b"fo"]) and len(line.split()) < 4:
            wrong = "a face of fewer than 3 corners, and no line end: the file is cut off"
        if wrong:
            return BadInput(f"{name}: line {number}: {wrong}; expected a Wavefront OBJ file")
    return BadInput(f"{name}: is damaged; expected a Wavefront OBJ file")


def _wrong(words: list[bytes]) -> str:
    if words and words[0] in (b"v", b"vn"):
        if len(words) < 4:
            return f"{len(words) - 1} numbers where 3 belong"
        for word in words[1:]:
            try:
                numbers(word)
            except ValueError:
                return f"{word.decode('utf-8', errors='replace')!r} is not a number"
    if words and words[0] in (b"f", b"fo"):
        for word in words[1:]:
            if not CORNER.fullmatch(word):
                return f"{word.decode('utf-8', errors='replace')!r} is not a corner of a face ('f 1 2 3')"
    return ""
