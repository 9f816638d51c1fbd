"""STL, read as a surface: corners at exactly equal positions become one vertex."""

from __future__ import annotations

import re

import numpy as np

from ...errors import BadInput
from .raw import RawGeometry

HEADER, FACET = 84, 50  # bytes
CUT_OFF = "The file is cut off; copy or export it again"


def read_stl(data: bytes, name: str) -> RawGeometry:
    """The merged triangles of a binary or ASCII STL file. The normals of facets are not read: the corners know them.

    Raises
    ------
    BadInput
        If it is no STL file, or shorter than it promises.
    """
    promised = int.from_bytes(data[80:HEADER], "little") if len(data) >= HEADER else -1
    # A binary file may begin with "solid" too, so its length is asked first.
    looks_ascii = data.lstrip()[:5].lower() == b"solid" and b"\0" not in data[:1024]
    if looks_ascii and len(data) != HEADER + promised * FACET:
        return merge_equal(_ascii(data, name))
    if promised < 0 or (not looks_ascii and _is_text(data)):
        raise BadInput(f"{name}: is no STL file; expected 'solid' and facets, or a binary header of {HEADER} bytes")
    if len(data) < HEADER + promised * FACET:
        there = (len(data) - HEADER) // FACET
        raise BadInput(f"{name}: ends early: it promises {promised} triangles, {there} are there. {CUT_OFF}")
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    with np.errstate(invalid="ignore"):  # of NaN, which is refused later
        return merge_equal(np.frombuffer(data, kind, promised, HEADER)["corners"].astype(np.float64))


def _ascii(data: bytes, name: str) -> np.ndarray:
    corners = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", data, re.IGNORECASE)
    facets = len(re.findall(rb"\bfacet\s+normal\b", data, re.IGNORECASE))
    if not re.search(rb"\bendsolid\b", data, re.IGNORECASE):
        raise BadInput(f"{name}: ends early: 'solid' without 'endsolid' after {facets} facets. {CUT_OFF}")
    if len(corners) != 3 * facets:
        raise BadInput(f"{name}: {len(corners)} corners for {facets} facets; expected three each. The file is damaged")
    try:
        return np.array(corners, dtype=np.float64).reshape(-1, 3, 3)
    except ValueError as error:
        raise BadInput(f"{name}: {error}; expected an STL file with three numbers for each vertex") from None


def _is_text(data: bytes) -> bool:
    head = data[:1024]
    return b"\0" not in head and all(32 <= byte < 127 or byte in b"\t\r\n" for byte in head)


def merge_equal(corners: np.ndarray) -> RawGeometry:
    """Triangles (f, 3, 3) as a mesh in which exactly equal corners are one vertex, numbered by first appearance."""
    points = corners.reshape(-1, 3) + 0.0  # -0.0 and 0.0 are one place
    order = np.lexsort(points.T)
    differs = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    group = np.empty(len(points), dtype=np.int64)
    group[order] = np.concatenate([[0], np.cumsum(differs)])[: len(points)]
    # lexsort is stable: the first of each group is its first appearance.
    first = order[np.concatenate([[True], differs])[: len(points)]]
    rank = np.empty(len(first), dtype=np.int64)
    by_appearance = np.argsort(first)
    rank[by_appearance] = np.arange(len(first))
    return RawGeometry(points[first[by_appearance]], rank[group].reshape(-1, 3))
