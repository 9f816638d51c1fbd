"""PCD, the point clouds of PCL: ascii, binary and binary_compressed, with all fields; written as binary."""

from __future__ import annotations

import re

import numpy as np

from ...errors import BadInput
from ...notices import notice
from ..cloud import PointCloud
from .columns import geometry_of, names_for, smallest_float
from .raw import RawGeometry
from .table_writer import lines
from .tables import as_utf8, numbers

EXPECTED = "expected a PCD file: a header with FIELDS, SIZE, TYPE, POINTS and DATA, then that many points"
KINDS = {"F": "f", "I": "i", "U": "u"}
SIZES = {"f": (4, 8), "i": (1, 2, 4, 8), "u": (1, 2, 4, 8)}
MOST_NUMBERS = 3  # of a field that is read as scalars; longer ones are descriptors of a neighbourhood


def read_pcd(data: bytes, name: str) -> RawGeometry:
    """The points of a PCD file; colours are unpacked, other fields than normals become scalars.

    Raises
    ------
    BadInput
        If it is no PCD file, or ends before all points that its header promises.
    """
    header, form, body = _header(data, name)
    kinds, count = _fields(header, name)
    table = READERS[form](body, kinds, count, name)
    if not len(table):
        raise BadInput(f"{name}: holds no points; {EXPECTED}")
    names, columns = [], []
    for title in _titles(kinds):
        values = table[title]
        label = title.rsplit("~", 1)[0]
        if is_packed(title) and values.dtype.itemsize == 4 and values.ndim == 1:
            names += ["r", "g", "b"]
            columns += _unpacked(np.ascontiguousarray(values))
        elif label != "_" and values.ndim == 1:
            names.append(label)
            columns.append(values)
        elif label != "_" and values.shape[1] <= MOST_NUMBERS:
            names += [f"{label}_{k + 1}" for k in range(values.shape[1])]
            columns += list(values.T)
        elif label != "_":
            notice(f"{name}: leaves out the field {label[:40]!r}, which has {values.shape[1]} numbers for each point")
    if not {"x", "y", "z"} <= {one.lower() for one in names}:
        raise BadInput(f"{name}: its fields are {', '.join(names)[:200]!r}; expected x, y and z among them")
    return geometry_of(np.stack(columns, axis=1, dtype=np.float64), names, name)


def is_packed(title: str) -> bool:
    """Whether a field holds a colour in the bits of its number; behind ``~`` is the number of the field."""
    return title.rsplit("~", 1)[0] in ("rgb", "rgba")


def write_pcd(cloud: PointCloud) -> bytes:
    """A cloud as a PCD file of floats: binary where these keep all numbers, otherwise text with all their digits.

    PCL and Open3D read no doubles from binary files, and coordinates far from the origin need them. Colours are 8 bit.
    """
    names, blocks = ["x", "y", "z"], [*cloud.points.T]
    if cloud.normals is not None:
        names += ["normal_x", "normal_y", "normal_z"]
        blocks += [*cloud.normals.T]
    if cloud.colors is not None:
        r, g, b = np.rint(np.clip(cloud.colors, 0, 1) * 255).astype(np.uint32).T
        names.append("rgb")
        blocks.append((r << 16 | g << 8 | b).view(np.float32))
    names += names_for(cloud.scalars, [*names, "rgb", "_"])
    blocks += cloud.scalars.values()
    is_exact = all(smallest_float(values) == "f4" for values in blocks)
    head = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(names)}",
        *(f"{key} {' '.join([value] * len(names))}" for key, value in (("SIZE", "4"), ("TYPE", "F"), ("COUNT", "1"))),
        f"WIDTH {len(cloud)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(cloud)}",
        f"DATA {'binary' if is_exact else 'ascii'}",
    ]
    table = np.stack(blocks, axis=1)
    body = table.astype("<f4").tobytes() if is_exact else lines(" ".join(["%.17g"] * len(names)), table)
    return "".join(f"{line}\n" for line in head).encode("ascii") + body


# -- the header --------------------------------------------------------------------------------------------------------


def _header(data: bytes, name: str) -> tuple[dict[str, list[str]], str, bytes]:
    """The words of each line, the form of the data, and the data."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    found = re.search(rb"^[ \t]*DATA[ \t]+(\w+)[ \t]*(?:\r\n|\r|\n|$)", data[:100_000], re.MULTILINE | re.IGNORECASE)
    if not found or found[1].lower().decode() not in READERS:
        raise BadInput(f"{name}: has no line 'DATA ascii', 'DATA binary' or 'DATA binary_compressed'; {EXPECTED}")
    lines = data[: found.start()].decode("utf-8", errors="replace").splitlines()
    words = [line.partition("#")[0].split() for line in lines]
    return {line[0].upper(): line[1:] for line in words if line}, found[1].lower().decode(), data[found.end() :]


def _fields(header: dict[str, list[str]], name: str) -> tuple[np.dtype, int]:
    """The type of a point, and how many there are; a field that has the name of another one gets a number."""
    titles = header.get("FIELDS", header.get("COLUMNS", []))
    counts = header.get("COUNT", ["1"] * len(titles))
    parts = [titles, header.get("SIZE", []), header.get("TYPE", []), counts]
    if not titles or len({len(part) for part in parts}) > 1:
        raise BadInput(f"{name}: its header does not give a size, type and count for each of its fields; {EXPECTED}")
    fields = []
    for k, (title, size, kind, count) in enumerate(zip(*parts, strict=True)):
        kind = KINDS.get(kind.upper(), "")
        if not (kind and size.isdecimal() and count.isdecimal() and int(size[:9]) in SIZES[kind]):
            what = f"{kind or '?'}{size[:9]}, {count[:9]} times"
            raise BadInput(f"{name}: the field {title[:40]!r} has the type {what!r}; {EXPECTED}")
        if not 0 < int(count[:9]) <= 100_000:
            raise BadInput(f"{name}: the field {title[:40]!r} has {count[:9]} numbers; expected at least 1")
        fields.append((f"{title}~{k}", f"<{kind}{size}", *([] if int(count) == 1 else [(int(count),)])))
    sizes = [header.get(key, []) for key in ("POINTS", "WIDTH", "HEIGHT")]
    points, width, height = (int(v[0]) if v and v[0].isdecimal() and len(v[0]) < 19 else None for v in sizes)
    if points is None and width is not None:
        points = width * (1 if height is None else height)
    if points is None:
        raise BadInput(f"{name}: its header does not say how many points there are; {EXPECTED}")
    return np.dtype(fields), points


# -- the data ----------------------------------------------------------------------------------------------------------


def _titles(kinds: np.dtype) -> tuple[str, ...]:
    """The fields of a point: there are some."""
    return kinds.names or ()


def _ascii(body: bytes, kinds: np.dtype, count: int, name: str) -> np.ndarray:
    widths = [int(np.prod(kinds[title].shape)) for title in _titles(kinds)]
    found = numbers(as_utf8(body, name), sum(widths), name)
    if len(found) < count:
        raise _ends_early(count, len(found), name)
    if len(found) > count:
        notice(f"{name}: there is more in the file than its header says; the rest is ignored")
    # A file may call its numbers float and give them more digits.
    deep = [
        (t, "<f8" if kinds[t].base.kind == "f" and not is_packed(t) else kinds[t].base, kinds[t].shape)
        for t in _titles(kinds)
    ]
    table, ends = np.empty(count, dtype=deep), np.cumsum(widths)
    for title, width, end in zip(_titles(kinds), widths, ends, strict=True):
        values = found[:count, end - width : end].reshape(count, *kinds[title].shape)
        # A whole number that is not finite, or has no room in its type, stays what it is after the file's own rules.
        with np.errstate(invalid="ignore", over="ignore"):
            table[title] = values if kinds[title].base.kind == "f" else values.astype(np.int64, casting="unsafe")
    return table


def _binary(body: bytes, kinds: np.dtype, count: int, name: str) -> np.ndarray:
    if len(body) < count * kinds.itemsize:
        raise _ends_early(count, len(body) // kinds.itemsize, name)
    return np.frombuffer(body, kinds, count)


def _compressed(body: bytes, kinds: np.dtype, count: int, name: str) -> np.ndarray:
    """All numbers of one field after those of the other."""
    packed, size = (int.from_bytes(body[k : k + 4], "little") for k in (0, 4))
    if size != count * kinds.itemsize:
        raise BadInput(
            f"{name}: its compressed data has {size:,} bytes, where {count:,} points of {kinds.itemsize} bytes need "
            f"{count * kinds.itemsize:,}. The file is damaged, export it again"
        )
    if len(body) < 8 + packed:
        raise BadInput(
            f"{name}: ends early: {len(body) - 8:,} of {packed:,} bytes are in the file. The file is cut off"
        )
    content = _expanded(body[8 : 8 + packed], size, name)
    table, at = np.empty(count, dtype=kinds), 0
    for title in _titles(kinds):
        kind = kinds[title]
        table[title] = np.frombuffer(content, kind, count, at).reshape(count, *kind.shape)
        at += count * kind.itemsize
    return table


READERS = {"ascii": _ascii, "binary": _binary, "binary_compressed": _compressed}


def _expanded(data: bytes, size: int, name: str) -> bytes:
    """What LZF has compressed: runs of bytes as they are, and references to what came before."""
    out, at = bytearray(), 0
    damaged = BadInput(f"{name}: its compressed data is damaged; expected {size:,} bytes. Copy or export it again")
    try:
        while at < len(data) and len(out) <= size:
            code = data[at]
            if code < 32:
                out += data[at + 1 : at + 2 + code]
                at += 2 + code
                continue
            length = code >> 5
            if length == 7:
                at += 1
                length += data[at]
            back = ((code & 31) << 8) + data[at + 1] + 1
            at += 2
            if back > len(out):
                raise damaged
            piece = out[-back:][: length + 2]
            out += piece if len(piece) == length + 2 else (piece * (length // len(piece) + 3))[: length + 2]
    except IndexError:
        raise damaged from None
    if len(out) != size:
        raise damaged
    return bytes(out)


def _ends_early(promised: int, there: int, name: str) -> BadInput:
    return BadInput(
        f"{name}: ends early: its header promises {promised:,} points, but the file holds {there:,}. The file is cut "
        "off; copy or export it again"
    )


def _unpacked(values: np.ndarray) -> list[np.ndarray]:
    """Red, green and blue in 0..1 from the bits of a number."""
    bits = values.view(np.uint32)
    return [((bits >> shift) & 255) / 255 for shift in (16, 8, 0)]
