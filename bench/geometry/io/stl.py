"""STL, read as a surface: corners at exactly equal positions become one vertex."""

from __future__ import annotations

import re

import numpy as np

from ...errors import BadInput
from ...notices import notice
from .merging import merge_equal
from .plain import decoded, first_word_that_is_no_number, numbers
from .raw import RawGeometry

HEADER, FACET = 84, 50  # bytes
CUT_OFF = "The file is cut off; copy or export it again"


def read_stl(data: bytes, name: str) -> RawGeometry:
    """The merged triangles of a binary or ASCII STL file. The normals of facets are not read: the corners know them.

    A binary file has as many triangles as its length says, whatever number it names, and an ASCII file needs no
    ``endsolid``, if all facets are whole. A notice reports if these are not as they should be.

    Raises
    ------
    BadInput
        If it is not an STL file, or ends within a facet.
    """
    promised = int.from_bytes(data[80:HEADER], "little") if len(data) >= HEADER else -1
    # A binary file may begin with "solid" too, so its length is asked first.
    if promised < 0 or len(data) != HEADER + promised * FACET:
        text = decoded(data).lstrip().lower()
        if text[:5] == b"solid" and b"\0" not in text[:1024]:
            return merge_equal(_ascii(text, name))
        if promised < 0 or _is_text(data):
            raise BadInput(
                f"{name}: is not an STL file; expected 'solid' and facets, or a binary header of {HEADER} bytes"
            )
    there, rest = divmod(len(data) - HEADER, FACET)
    if rest and (promised > there or not promised):
        raise BadInput(f"{name}: ends early: it promises {promised} triangles, but the file holds {there}. {CUT_OFF}")
    if not rest and promised != there:
        notice(
            f"{name}: its header says {promised} triangles, but it holds {there}, all whole, which are read. Export it "
            "again if there should be more"
        )
        promised = there
    elif rest or promised < there:
        notice(f"{name}: there is more in the file than the {promised} triangles of its header; the rest is ignored")
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    with np.errstate(invalid="ignore"):  # of NaN, which is left out later
        return merge_equal(np.frombuffer(data, kind, promised, HEADER)["corners"].astype(np.float64).reshape(-1, 3))


def _ascii(text: bytes, name: str) -> np.ndarray:
    """The corners (3 f, 3) of all facets of a text in small letters, of whatever solid."""
    # No \b before the words: then the first letters are searched for, which is several times as fast.
    facets, ended = len(re.findall(rb"facet\s+normal\b", text)), len(re.findall(rb"end\s*facet\b", text))
    closed = re.search(rb"end\s*solid\b", text[max(text.rfind(b"facet"), 0) :])
    if not closed and (ended != facets or not text.rstrip().endswith((b"endfacet", b"end facet"))):
        raise BadInput(f"{name}: ends early: 'solid' without 'endsolid' after {facets} facets. {CUT_OFF}")
    places = re.findall(rb"vertex\s+(\S+\s+\S+\s+\S+)", text)
    if len(places) != 3 * facets:
        raise BadInput(f"{name}: {len(places)} corners for {facets} facets; expected three each. The file is damaged")
    joined = b" ".join(places)
    try:
        corners = numbers(joined)
    except ValueError:
        wrong = first_word_that_is_no_number(joined)
        raise BadInput(f"{name}: holds {wrong!r}; expected an STL file with three numbers for each vertex") from None
    if not closed:
        notice(f"{name}: has no 'endsolid' at its end; its {facets} facets are whole. Export it again if more belong")
    return corners.reshape(-1, 3)


def _is_text(data: bytes) -> bool:
    head = data[:1024]
    return b"\0" not in head and all(32 <= byte < 127 or byte in b"\t\r\n" for byte in head)
