"""NumPy's files: an array of points, or several arrays by name. Nothing in them is executed."""

from __future__ import annotations

import io
import tokenize
import zipfile
import zlib
from typing import Any

import numpy as np

from ...errors import BadInput
from ...notices import notice
from .columns import geometry_of, plain_name
from .raw import NO_FACES, RawGeometry

EXPECTED = "expected an array of numbers with a row for each point: x y z, then its other values"
POINTS = ("points", "xyz", "pos", "positions", "vertices", "coords", "pc", "cloud", "point_cloud", "data", "arr_0")
NORMALS = ("normals", "normal", "normals_xyz")
# What the header, a literal of Python, fails with where it is damaged.
NO_HEADER = (ValueError, TypeError, KeyError, SyntaxError, tokenize.TokenError, EOFError, MemoryError, RecursionError)
COLORS = ("colors", "colours", "rgb", "color")


def read_npy(data: bytes, name: str) -> RawGeometry:
    """The points in an array of shape (n, 3) or more columns, or of records with named fields.

    Raises
    ------
    BadInput
        If it is no such array, holds Python objects, or ends early.
    """
    return _points(_array(data, name), name)


def read_npz(data: bytes, name: str) -> RawGeometry:
    """The array of points in an archive, with its ``normals`` and ``colors``, and arrays of a number for each point.

    Raises
    ------
    BadInput
        If it is no such archive, or which array has the points is not clear.
    """
    arrays = _arrays(data, name)
    tables = [key for key, array in arrays.items() if array.ndim == 2 and array.shape[1] >= 3]
    by_name = {plain_name(key): key for key in tables}
    chosen = next((by_name[word] for word in POINTS if word in by_name), tables[0] if len(tables) == 1 else None)
    if chosen is None:
        shapes = ", ".join(f"{key} {array.shape}" for key, array in arrays.items())[:200]
        raise BadInput(f"{name}: holds {shapes or 'no array'}; expected one called points, of shape (n, 3)")
    raw = _points(arrays.pop(chosen), name)
    count, parts = len(raw.vertices), {"normals": raw.normals, "colors": raw.colors}
    for part, words in (("normals", NORMALS), ("colors", COLORS)):
        for key in [key for key in arrays if plain_name(key) in words and arrays[key].shape == (count, 3)]:
            parts[part] = arrays.pop(key).astype(np.float64)
    if parts["colors"] is not None and raw.colors is None:
        named = geometry_of(np.hstack([raw.vertices, parts["colors"]]), ["x", "y", "z", "r", "g", "b"], name)
        parts["colors"] = named.colors
    scalars = dict(raw.scalars or {})
    for key, array in list(arrays.items()):
        if array.shape in ((count,), (count, 1)) and count > 1:
            scalars[plain_name(key)] = arrays.pop(key).astype(np.float64).ravel()
    if arrays:
        notice(f"{name}: takes {chosen} for the points, and ignores {', '.join(arrays)[:100]}")
    return RawGeometry(raw.vertices, NO_FACES, parts["normals"], parts["colors"], scalars)


def _arrays(data: bytes, name: str) -> dict[str, np.ndarray]:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
            total = sum(entry.file_size for entry in entries)
            if total > 2000 * len(data) + 1_000_000:  # more than deflate can do
                raise BadInput(f"{name}: its arrays claim to have {total:,} bytes; expected less. It is damaged")
            return {entry.filename[:-4]: _array(archive.read(entry), name) for entry in entries}
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, EOFError, RuntimeError, OSError, KeyError) as error:
        raise BadInput(f"{name}: is not a numpy archive, or damaged ({error}); {EXPECTED}") from None


def _array(data: bytes, name: str) -> np.ndarray:
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, in_columns, kind = read(stream)
    except NO_HEADER as error:
        raise BadInput(f"{name}: is not a numpy array ({str(error)[:100]}); {EXPECTED}") from None
    if kind.hasobject:
        raise BadInput(f"{name}: holds Python objects, which are not loaded; {EXPECTED}")
    size = 1
    for length in shape:
        size *= length
    there = len(data) - stream.tell()
    if min(shape, default=0) < 0 or size * kind.itemsize > there or not kind.itemsize:
        raise BadInput(
            f"{name}: ends early: its header promises an array of {shape}, {size * kind.itemsize:,} bytes, and "
            f"{there:,} are in the file. The file is cut off; copy or save it again"
        )
    return np.frombuffer(data, kind, size, stream.tell()).reshape(shape, order="F" if in_columns else "C")


def _points(array: np.ndarray, name: str) -> RawGeometry:
    if array.dtype.names:
        return _records(array.ravel(), name)
    if array.dtype.kind not in "iufb":
        raise BadInput(f"{name}: holds an array of {array.dtype}; {EXPECTED}")
    if array.ndim == 3 and array.shape[2] >= 3:  # an organised cloud: rows and columns of an image
        array = array.reshape(array.shape[0] * array.shape[1], array.shape[2])
    if array.ndim != 2 or not 3 <= array.shape[1] <= 100:
        turned = " Transpose it" if array.ndim == 2 and 3 <= array.shape[0] <= 9 else ""
        raise BadInput(f"{name}: holds an array of shape {array.shape}; {EXPECTED}.{turned}")
    if not len(array):
        raise BadInput(f"{name}: holds an array of no rows; {EXPECTED}")
    return geometry_of(array.astype(np.float64), [], name)


def _records(array: np.ndarray, name: str) -> RawGeometry:
    names, columns = [], []
    for title in array.dtype.names or ():
        values: Any = array[title]
        if values.dtype.kind not in "iufb" or values.ndim > 2:
            notice(f"{name}: leaves out the field {title[:40]!r}, which is not a number")
        elif values.ndim == 1:
            names.append(title)
            columns.append(values)
        elif values.shape[1] == 3 and title in (*POINTS, *NORMALS, *COLORS):
            letters = {POINTS: ("x", "y", "z"), NORMALS: ("nx", "ny", "nz"), COLORS: ("r", "g", "b")}
            names += next(group for words, group in letters.items() if title in words)
            columns += list(values.T)
        else:
            names += [f"{title}_{k + 1}" for k in range(values.shape[1])]
            columns += list(values.T)
    if not 3 <= len(columns) <= 100:
        raise BadInput(f"{name}: holds records of {len(columns)} numbers; {EXPECTED}")
    return geometry_of(np.stack(columns, axis=1, dtype=np.float64), names, name)
