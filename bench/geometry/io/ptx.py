"""PTX, the grids of scanners: each scan has its size, its pose, and a line for each cell of the grid."""

from __future__ import annotations

import numpy as np

from ...errors import BadInput
from ...notices import notice
from .columns import geometry_of
from .raw import RawGeometry
from .scans import notice_scans
from .tables import as_utf8, numbers

NAMES = ("x", "y", "z", "intensity", "r", "g", "b")
HEAD = 10  # lines: columns, rows, the position and axes of the scanner, and the matrix that moves the points
EXPECTED = "expected a PTX file: for each scan columns, rows, 4 lines of 3 numbers, 4 lines of 4, then a line a cell"


def read_ptx(data: bytes, name: str) -> RawGeometry:
    """The points of all scans, moved by their matrices into one coordinate system; cells without a return are left out.

    Several scans have the scalar ``scan``, from 0.

    Raises
    ------
    BadInput
        If it is no PTX file, or ends before all cells of a scan.
    """
    data = as_utf8(data, name).rstrip() + b"\n"
    ends = np.flatnonzero(np.frombuffer(data, dtype=np.uint8) == ord("\n"))
    begins = np.concatenate([[0], ends[:-1] + 1])
    scans: list[np.ndarray] = []
    line = cells = 0
    while line < len(ends):
        if line + HEAD > len(ends):
            raise BadInput(f"{name}: line {line + 1}: a scan begins, and the file ends; {EXPECTED}")
        count, matrix = _head(data[begins[line] : ends[line + HEAD - 1]], line, name)
        first, line = line + HEAD, line + HEAD + count
        if line > len(ends):
            raise BadInput(
                f"{name}: ends early: scan {len(scans) + 1} promises {count:,} cells, but the file holds "
                f"{len(ends) - first:,}. The file is cut off; copy or export it again"
            )
        body = data[begins[first] : ends[line - 1]]
        width = len(body.split(b"\n", 1)[0].split())
        if width not in (3, 4, 7):
            raise BadInput(f"{name}: line {first + 1} has {width} numbers; expected x y z intensity, and perhaps r g b")
        table = numbers(body, width, name, above=first)
        table = table[(table[:, :3] != 0).any(axis=1)]
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite then is left out with what was not
            table[:, :3] = table[:, :3] @ matrix[:3, :3] + matrix[3, :3]
        scans.append(table)
        cells += count
    return _joined(scans, cells, name)


def _head(text: bytes, above: int, name: str) -> tuple[int, np.ndarray]:
    """How many cells a scan has, and the (4, 4) matrix that its points are multiplied with from the right."""
    rows = [line.split() for line in text.split(b"\n")]
    for k, (row, width) in enumerate(zip(rows, (1, 1, 3, 3, 3, 3, 4, 4, 4, 4), strict=True)):
        if len(row) != width or (k < 2 and not (row[0].isdigit() and 0 < int(row[0][:9]) < 10**6)):
            raise BadInput(f"{name}: line {above + k + 1} is not part of a PTX header; {EXPECTED}")
    matrix = numbers(b"\n".join(b" ".join(row) for row in rows[6:]), 4, name, above=above + 6)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise BadInput(f"{name}: lines {above + 7} to {above + HEAD} are not a matrix; {EXPECTED}")
    return int(rows[0][0]) * int(rows[1][0]), matrix


def _joined(scans: list[np.ndarray], cells: int, name: str) -> RawGeometry:
    """The points of all scans, with the columns that all of them have."""
    width = min(table.shape[1] for table in scans)
    table = np.concatenate([table[:, :width] for table in scans])
    if not len(table):
        raise BadInput(f"{name}: none of its {cells:,} cells has a return; expected points")
    if len(table) < cells:
        notice(f"{name}: {cells - len(table):,} of {cells:,} cells have no return; they are left out")
    raw = geometry_of(table, NAMES[:width], name)
    if len(scans) > 1:
        notice_scans(len(scans), name)
        number = np.repeat(np.arange(len(scans), dtype=np.float64), [len(table) for table in scans])
        raw = raw._replace(scalars=(raw.scalars or {}) | {"scan": number})
    return raw
