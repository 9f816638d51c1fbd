"""OBJ files as programs write them, each against a plain reading of its lines."""

from __future__ import annotations

import numpy as np
import pytest
from cube_files import NORMALS, QUADS, V, check_cube, lines, with_parts

from bench import BadInput
from bench.geometry.io.obj import read_obj
from bench.geometry.io.obj_vertices import save_with_vertices
from bench.notices import collected

VERTICES = lines(V, "v ")
FACES = lines([[c + 1 for c in q] for q in QUADS], "f ")
WITH_NORMALS = VERTICES + lines(NORMALS, "vn ")
CUBE = VERTICES + FACES


def corners(form, polygons=QUADS):
    return "".join("f " + " ".join(form(c) for c in q) + "\n" for q in polygons)


def read(text: str | bytes, *notices: str):
    data = text if isinstance(text, bytes) else text.encode()
    with collected() as said:
        raw = read_obj(data, "name")
    assert len(said) == len(notices) and all(part in one for part, one in zip(notices, said, strict=True)), said
    return raw


KINDS = {
    "CR": CUBE.replace("\n", "\r"),
    "CRLF and tabs": CUBE.replace("\n", "\r\n").replace(" ", "\t"),
    "a line that goes on": CUBE.replace("4 8", "4 \\\n 8"),
    "a line that goes on, CRLF": CUBE.replace("4 8", "4 \\\n 8").replace("\n", "\r\n"),
    "blanks before, no end of the last line": "\n  " + CUBE.replace("\n", "\n\t ").rstrip(),
    "comments": "# v 1 2 3\n" + CUBE.replace("\n", " # f 1 2 3\n"),
    "faces before vertices": FACES + VERTICES,
    "the old keyword": CUBE.replace("f ", "fo "),
    "negative indices": VERTICES + corners(lambda c: f"{c - 8}"),
    "vertices between faces": "".join(VERTICES + corners(lambda c: f"{c - 8}", [q]) for q in QUADS),
    "texture": VERTICES + "vt 0 0\n" + corners(lambda c: f"{c + 1}/1"),
    "empty places": VERTICES + corners(lambda c: f"{c + 1}//"),
    "corners of all forms": WITH_NORMALS + corners(lambda c: ("1", "2/", "3/1", "4//4", "5/1/5", "6//", "7", "8")[c]),
    "lines, points, groups": CUBE + "l 1 2 3\np 1\ng a\ns off\nusemtl b\ncurv 0 1 1 2\nvp 1 2\nvt 1\n",
    "weights of 1": lines(with_parts(1), "v ") + FACES,
}


@pytest.mark.parametrize("text", KINDS.values(), ids=KINDS)
def test_kinds_of_text(text):
    raw = read(text)
    check_cube(raw, vertices=48) if text == KINDS["vertices between faces"] else check_cube(raw)
    assert raw.colors is None and raw.normals is None


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_encodings(encoding, tmp_path):
    check_cube(read(CUBE.encode(encoding)))
    (tmp_path / "in.obj").write_bytes(CUBE.encode(encoding))
    save_with_vertices(tmp_path / "in.obj", np.array(V) + 1.0, tmp_path / "out.obj")
    raw = read((tmp_path / "out.obj").read_bytes())
    assert np.array_equal(raw.vertices, np.array(V) + 1.0) and len(raw.faces) == 12


@pytest.mark.parametrize(
    "text",
    [
        WITH_NORMALS + corners(lambda c: f"{c + 1}//{c + 1}"),
        WITH_NORMALS + corners(lambda c: f"{c + 1}/9/{c + 1}"),
        WITH_NORMALS + corners(lambda c: f"{c - 8}//{c - 8}"),
        WITH_NORMALS + FACES,
        WITH_NORMALS,
    ],
)
def test_normals_of_vertices(text):
    assert np.array_equal(read(text).normals, NORMALS)


@pytest.mark.parametrize(
    ("parts", "color"),
    [((1, 0.2, 0), (1, 0.2, 0)), ((1, 0.2, 0, 0.5), (1, 0.2, 0)), ((255, 51, 0), (1, 0.2, 0)), ((1, 0, 0), (1, 0, 0))],
)
def test_colours_of_vertices(parts, color):
    assert read(lines(with_parts(*parts), "v ") + FACES).colors == pytest.approx(np.tile(color, (8, 1)), abs=1e-15)


def test_omissions_are_reported():
    check_cube(read(VERTICES + "f 1 2\n" + FACES + "f 3\n", "2 faces of fewer than 3 corners are left out"))
    some = lines(with_parts(1, 0, 0)[:4], "v ") + lines(V[4:], "v ") + FACES
    assert check_cube(read(some, "4 of 8 vertices have colours")).colors is None
    check_cube(read(lines(with_parts(2), "v ") + FACES, "8 vertices have weights other than 1"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (CUBE + "f 1 2", "line 15: a face of fewer than 3 corners"),
        (CUBE + "f 1 2 x\n", "line 15: 'x' is not a corner"),
        (CUBE + "f 1 2 3.0\n", "line 15: '3.0'"),
        (CUBE + "f 1 2 /3\n", "line 15: '/3'"),
        (CUBE + "f 1 2 1///3\n", "line 15: '1///3'"),
        (CUBE + "f 1 2 1/2/3/4\n", "line 15: '1/2/3/4'"),
        (CUBE + "v 1,5 2 3\n", "line 15: '1,5' is not a number"),
        (CUBE + "\nv 1_0 2 3\n", "line 16: '1_0' is not a number"),
        (CUBE + "v 1-2 3\n", "line 15: 2 numbers where 3 belong"),
        (CUBE + "v 1-2 3 4\n", "line 15: '1-2' is not a number"),
        (CUBE + "v\n", "line 15: 0 numbers"),
        (CUBE + "vn 1 2\n", "line 15: 2 numbers"),
        (CUBE + "f 1 2 9\n", "name vertices that do not exist"),
        (CUBE + "f 1 2 0\n", "name vertices that do not exist"),
        (CUBE + "f 1 2 99999999999999999999999\n", "name vertices that do not exist"),
        (VERTICES + corners(lambda c: f"{c - 9}"), "name vertices that do not exist"),
        ("o nothing\n", "holds no vertices"),
    ],
)
def test_invalid_files_are_refused(text, says):
    with pytest.raises(BadInput) as error:
        read(text)
    assert str(error.value).startswith("name: ") and says in str(error.value)


def test_every_number_is_the_nearest_double():
    values = np.random.default_rng(0).normal(size=(500, 3)) * 10.0 ** np.arange(-150, 150, 0.6)[:, None]
    assert np.array_equal(read(lines(values, "v ")).vertices, values)
