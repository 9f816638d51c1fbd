"""PLY files as programs write them: strips, other names, other line ends, rows longer than the header says."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from cube_files import NORMALS, QUADS, V, check_cube, lines, ply, sized, with_parts

from bench import BadInput
from bench.geometry.io.ply import read_ply
from bench.geometry.io.strips import triangles_of_strips
from bench.notices import collected


def read(text: str | bytes, *notices: str):
    data = text if isinstance(text, bytes) else text.encode()
    with collected() as said:
        raw = read_ply(data, "name")
    assert len(said) == len(notices) and all(part in one for part, one in zip(notices, said, strict=True)), said
    return raw


# -- headers -----------------------------------------------------------------------------------------------------------

BINARY_HEAD = ply("x y z", [], []).replace("ascii", "binary_little_endian").replace("vertex 0", "vertex 8")
BINARY_HEAD = BINARY_HEAD.replace("end_h", "element face 6\nproperty list uchar int vertex_indices\nend_h").encode()
FACE_BYTES = b"".join(struct.pack("<B4i", 4, *q) for q in QUADS)
BODY = struct.pack("<24f", *np.ravel(V)) + FACE_BYTES


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_line_ends_and_byte_order_marks(end, mark):
    check_cube(read(mark + ply().encode().replace(b"\n", end)))
    check_cube(read(mark + BINARY_HEAD.replace(b"\n", end) + BODY))
    check_cube(read(mark + BINARY_HEAD.replace(b"end_header\n", b"end_header  \n").replace(b"\n", end) + BODY))


def test_data_that_begin_with_a_line_feed_after_a_header_with_cr():
    first = struct.unpack("<f", b"\n\0\0\0")[0]
    data = BINARY_HEAD.replace(b"\n", b"\r") + b"\n\0\0\0" + BODY[4:]
    raw = read(data)
    assert raw.vertices[0].tolist() == [first, 0, 0] and raw.vertices[1:].tolist() == [list(v) for v in V[1:]]


def test_utf16_blank_lines_and_a_comment_that_names_the_end():
    check_cube(read(ply().encode("utf-16")))
    check_cube(read(ply().replace("\n", "\n\n")))
    check_cube(read(ply(more=["comment end_header"])))


def test_indices_of_eight_bytes():
    faces = b"".join(struct.pack("<B4q", 4, *q) for q in QUADS)
    check_cube(read(BINARY_HEAD.replace(b"uchar int", b"uint8 int64") + BODY[: 8 * 12] + faces))


def test_a_header_without_its_line_of_faces():
    with pytest.raises(BadInput, match="no line 'element face'"):
        read(BINARY_HEAD.replace(b"element face 6\n", b"") + BODY)


# -- names -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("names", ["nx ny nz", "normal_x normal_y normal_z", "NX NY NZ", "nxx nyy nzz", "n_x n_y n_z"])
def test_names_of_normals(names):
    raw = read(ply(f"x y z {names}", np.hstack([V, NORMALS])))
    assert np.array_equal(raw.normals, NORMALS) and raw.scalars is None


@pytest.mark.parametrize("names", ["red green blue", "r g b", "R G B", "diffuse_red diffuse_green diffuse_blue"])
@pytest.mark.parametrize(
    ("kind", "stored", "color"),
    [
        ("uchar", (255, 51, 0), (1, 0.2, 0)),
        ("uchar", (1, 0, 1), (1 / 255, 0, 1 / 255)),
        ("ushort", (65535, 13107, 0), (1, 0.2, 0)),
        ("int", (255, 51, 0), (1, 0.2, 0)),
        ("float", (1, 0.2, 0), (1, 0.2, 0)),
        ("float", (1, 1, 0), (1, 1, 0)),
        ("double", (255, 51, 0), (1, 0.2, 0)),
    ],
)
def test_names_and_types_of_colours(names, kind, stored, color):
    columns = " ".join(f"{kind}:{name}" for name in names.split())
    raw = read(ply(f"x y z {columns}", with_parts(*stored)))
    assert raw.colors == pytest.approx(np.tile(color, (8, 1)), abs=1e-15) and raw.scalars is None


def test_the_colour_of_diffuse_light_comes_first():
    names = "ambient_red ambient_green ambient_blue diffuse_red diffuse_green diffuse_blue"
    raw = read(ply("x y z " + " ".join(f"uchar:{name}" for name in names.split()), with_parts(9, 9, 9, 255, 0, 0)))
    assert raw.colors[5].tolist() == [1, 0, 0] and set(raw.scalars) == {
        f"ambient_{c}" for c in ("red", "green", "blue")
    }


def test_other_numbers_of_vertices_are_scalars():
    raw = read(ply("z y x scalar_Intensity double:gps int:class", [(*v[::-1], 0.5, k, -k) for k, v in enumerate(V)]))
    check_cube(raw)
    assert raw.normals is None and raw.colors is None
    assert {name: values.tolist() for name, values in raw.scalars.items()} == {
        "scalar_Intensity": [0.5] * 8,
        "gps": list(range(8)),
        "class": [-k for k in range(8)],
    }
    assert all(values.dtype == np.float64 for values in raw.scalars.values())


def test_one_notice_names_what_is_not_read():
    more = ["property list uchar float texcoord", "property uchar red", "property int region", "element edge 1"]
    text = ply(polygons=[], more=["property list uchar int seen", "element face 6", "property list uchar int indices"])
    text = text.replace("end_header", "\n".join([*more, "property int vertex1", "end_header"]))
    head = text[: text.index("end_header")] + "end_header\n"
    body = lines(with_parts(1, 7)) + lines(sized(QUADS, 2, 0.5, 0.5, 255, 3)) + "0\n"
    check_cube(read(head + body, "name: not read from it: seen of vertices, region of faces, element edge"))


# -- strips and rows ---------------------------------------------------------------------------------------------------

AROUND, LEFT, RIGHT = (1, 0, 2, 3, 6, 7, 5, 4, 1, 0), (0, 4, 3, 7), (1, 2, 5, 6)


@pytest.mark.parametrize(
    "strips",
    [
        [AROUND, LEFT, RIGHT],
        [(*AROUND, -1, *LEFT, -1, *RIGHT)],
        [(-1, *AROUND, -1, -1), (*LEFT, -1, *RIGHT, -1)],
        [(*AROUND, 0, 0, *LEFT, 7, 1, *RIGHT)],  # bridges instead of restarts
    ],
)
def test_triangle_strips(strips):
    more = [f"element tristrips {len(strips)}", "property list int int vertex_indices"]
    check_cube(read(ply(polygons=[], more=more, body=lines(sized(strips)))))
    kept = ply(polygons=QUADS, more=more, body=lines(sized(strips)))
    check_cube(read(kept), times=2)


def test_strips_match_a_loop():
    rng = np.random.default_rng(0)
    for _ in range(50):
        sizes = rng.integers(0, 9, size=4)
        corners = rng.integers(-1, 6, size=sizes.sum())
        expected = []
        for strip in np.split(corners, np.cumsum(sizes)[:-1]):
            run = []
            for corner in strip.tolist():
                run = [*run, corner] if corner >= 0 else []
                if len(run) > 2 and len(set(run[-3:])) == 3:
                    a, b, c = run[-3:]
                    expected.append([a, b, c] if len(run) % 2 else [b, a, c])
        assert triangles_of_strips(sizes, corners, 6, "name").tolist() == expected
    with pytest.raises(BadInput, match="1 corners of triangle strips name vertices that do not exist"):
        triangles_of_strips(np.array([3]), np.array([0, 1, 6]), 6, "name")


def test_rows_of_more_numbers_than_the_header_declares():
    """MeshLab writes colours of faces as a list where its header says four numbers."""
    channels = [f"property uchar {channel}" for channel in ("red", "green", "blue", "alpha")]
    more = ["element face 6", "property list uchar int vertex_indices", *channels]
    text = ply(polygons=[], more=more, body=lines(sized(QUADS, 4, 255, 0, 0, 255)))
    check_cube(read(text, "has rows of more numbers than its header says"))
    with pytest.raises(BadInput, match="ends early"):
        read(text.replace("face 6", "face 7"))
    with pytest.raises(BadInput, match="holds '2x' instead of a number"):
        read(ply().replace("4 0 3 2 1", "4 0 3 2x 1"))
