"""OFF files as programs write them: any line breaks, letters before the word OFF, binary."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from cube_files import NORMALS, QUADS, TRIANGLES, V, check_cube, lines, sized, spread, with_parts

from bench import BadInput
from bench.geometry.io.off import read_off
from bench.notices import collected

VERTICES, FACES = lines(V), lines(sized(TRIANGLES))
QUAD_LINES = lines(sized(QUADS))


def read(text: str | bytes, *notices: str):
    data = text if isinstance(text, bytes) else text.encode()
    with collected() as said:
        raw = read_off(data, "name")
    assert len(said) == len(notices) and all(part in one for part, one in zip(notices, said, strict=True)), said
    return raw


BODY = VERTICES + FACES
KINDS = {
    "counts glued to the word": "OFF8 12 0\n" + BODY,
    "blanks before, counts in two lines": "  \n\n OFF8 12\n0\n" + BODY,
    "counts in three lines": "OFF\n8\n12\n0\n" + BODY,
    "no number of edges": "OFF\n8 12\n" + BODY,
    "one number a line": "OFF\n8\n12\n0\n" + spread(V) + spread(sized(TRIANGLES)),
    "one index a line": "OFF\n8 12 0\n" + VERTICES + spread(sized(TRIANGLES)),
    "quads, one index a line": "OFF\n8 6 0\n" + VERTICES + spread(sized(QUADS)),
    "all in one line": "OFF 8 12 0 " + " ".join(BODY.split()),
    "two vertices a line": "OFF\n8 12 0\n" + lines([V[k] + V[k + 1] for k in range(0, 8, 2)]) + FACES,
    "no word": "8 12 0\n" + BODY,
    "no word, no number of edges": "8 12\n" + BODY,
    "small letters": "off\n8 12 0\n" + BODY,
    "comments and blank lines": "# a\n\nOFF # a\n# 7\n\n8 12 0 # 9\n# 1 2 3\n" + BODY.replace("\n", " # a\n\n") + "# 1",
    "three dimensions": "nOFF\n3\n8 12 0\n" + BODY,
    "tabs and CRLF": ("OFF\n8 12 0\n" + BODY).replace(" ", "\t").replace("\n", "\r\n"),
    "CR": ("OFF\n8 12 0\n" + BODY).replace("\n", "\r"),
    "colours of faces": "OFF\n8 6 0\n" + VERTICES + lines(sized(QUADS, 255, 0, 9)),
    "indices of colours": "OFF\n8 6 0\n" + VERTICES + lines(sized(QUADS[:3], 7) + sized(QUADS[3:], 0.5, 0, 1, 1)),
}


@pytest.mark.parametrize("text", KINDS.values(), ids=KINDS)
def test_kinds_of_text(text):
    check_cube(read(text))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_encodings(encoding):
    check_cube(read(("OFF\n8 12 0\n" + BODY).encode(encoding)))


@pytest.mark.parametrize("layout", [lines, spread])
@pytest.mark.parametrize(
    ("word", "parts"),
    [
        ("COFF", [(255, 51, 0, 255)]),
        ("COFF", [(1.0, 0.2, 0.0, 0.5)]),
        ("NOFF", [NORMALS]),
        ("STOFF", [(0.5, 0.25)]),
        ("CNOFF", [NORMALS, (255, 51, 0, 255)]),
        ("NCOFF", [(255, 51, 0, 255), NORMALS]),  # MeshLab's
        ("STCNOFF", [NORMALS, (255, 51, 0, 9), (0.5, 0.25)]),
    ],
)
def test_letters_declare_what_a_vertex_has(layout, word, parts):
    columns = [np.asarray(V), *(np.broadcast_to(part, (8, np.shape(part)[-1])) for part in parts)]
    rows = [[f"{number:g}" for number in row] for row in np.hstack(columns)]
    raw = check_cube(read(f"{word}\n8 6 0\n{layout(rows)}{layout(sized(QUADS))}"))
    assert (raw.normals is None) == ("N" not in word) and (raw.colors is None) == ("C" not in word)
    if "N" in word:
        assert np.array_equal(raw.normals, NORMALS)
    if "C" in word:
        assert np.allclose(raw.colors, (1, 0.2, 0), atol=1e-12)


def test_colours_without_opacity_and_homogeneous_coordinates():
    assert read("COFF\n8 6 0\n" + lines(with_parts(255, 51, 0)) + QUAD_LINES).colors[3].tolist() == [1, 0.2, 0]
    check_cube(read("4OFF\n8 6 0\n" + lines([(2 * x, 2 * y, 2 * z, 2) for x, y, z in V]) + QUAD_LINES))


def test_omissions_are_reported():
    check_cube(read("OFF\n8 6 0\n" + lines(with_parts(255, 0, 0)) + QUAD_LINES, "more numbers than OFF says"))
    check_cube(read("NOFF\n8 6 0\n" + VERTICES + QUAD_LINES, "fewer numbers than NOFF says"))
    check_cube(read("OFF\n8 6 0\n" + VERTICES + QUAD_LINES + "1 2 3\n", "more in the file"))
    check_cube(read("OFF\n8 7 0\n" + VERTICES + "2 0 1\n" + QUAD_LINES, "1 faces of fewer than 3 corners"))


@pytest.mark.parametrize("colors", [(), (1.0, 0.5, 0.0)])
def test_binary(colors):
    data = b"OFF BINARY\n" + struct.pack(">3i", 8, 6, 0) + struct.pack(">24f", *np.ravel(V))
    data += b"".join(struct.pack(f">6i{len(colors)}f", 4, *q, len(colors), *colors) for q in QUADS)
    check_cube(read(data))
    with pytest.raises(BadInput, match="promises 6 of 'face', but the file holds 5"):
        read(data[:-3])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("OFF\n8 6 0\n" + (VERTICES + QUAD_LINES)[:-10], "promises 6 of 'face', but the file holds 5"),
        ("OFF\n8 6 0\n" + VERTICES[:-8], "ends early: it promises 8 vertices"),
        ("OFF\n8 6 0\n" + VERTICES.replace("1", "l") + QUAD_LINES, "holds 'l' instead of a number"),
        ("OFF\n-8 6 0\n", "promises -8 vertices"),
        ("OFF\n8.5 6 0\n" + BODY, "promises 8.5 vertices"),
        ("OFF\n8\n", "does not give the numbers"),
        ("OFF\n", "does not give the numbers"),
        ("nOFF\n4\n8 6 0\n", "another dimension"),
        ("CCOFF\n8 6 0\n", "letters of 'CCOFF'"),
        ("8 6 0\n" + BODY, "more numbers than"),
        ("OFF\n8 6 0\n" + VERTICES + QUAD_LINES.replace("6", "8"), "name vertices that do not exist"),
        ("OFF\n8 6 0\n" + VERTICES + QUAD_LINES.replace("6", "6.5"), "name vertices that do not exist"),
    ],
)
def test_invalid_files_are_refused(text, says):
    with pytest.raises(BadInput) as error, collected():
        read_off(text.encode(), "name")
    assert str(error.value).startswith("name: ") and says in str(error.value)
