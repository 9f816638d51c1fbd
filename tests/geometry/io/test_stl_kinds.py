"""STL files as programs write them: wrong counts, missing ends, several solids; and triangles that are not finite."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from cube_files import TRIANGLES, V, check_cube, lines

from bench import BadInput, PointCloud
from bench.commands.score import load as load_to_score
from bench.geometry.io.files import load_geometry, load_mesh
from bench.geometry.io.stl import read_stl
from bench.notices import collected

CORNERS = [[V[c] for c in t] for t in TRIANGLES]
NAN = [[("nan", 0, 0), (1, 0, 0), (0, 1, 0)]]


def text(facets=CORNERS, name="a", end="endsolid a\n"):
    rows = (f"facet normal 0 0 1\nouter loop\n{lines(t, 'vertex ')}endloop\nendfacet\n" for t in facets)
    return f"solid {name}\n{''.join(rows)}{end}"


def binary(count=12, head=b"", facets=CORNERS, tail=b""):
    rows = (struct.pack("<12fH", 0, 0, 1, *np.ravel(np.array(t, dtype=float)), 0) for t in facets)
    return head.ljust(80, b"\0") + struct.pack("<I", count) + b"".join(rows) + tail


def read(data: str | bytes, *notices: str):
    with collected() as said:
        raw = read_stl(data if isinstance(data, bytes) else data.encode(), "name")
    assert len(said) == len(notices) and all(part in one for part, one in zip(notices, said, strict=True)), said
    return raw


KINDS = {
    "plain": text(),
    "end solid": text(end="end solid a"),
    "no name": text(name=""),
    "large letters": text().upper(),
    "one line": " ".join(text().split()),
    "CR": text().replace("\n", "\r"),
    "blanks before": " \n\t" + text(),
    "byte order mark": text().encode("utf-8-sig"),
    "UTF-16": text().encode("utf-16"),
    "binary": binary(),
    "binary that begins with solid": binary(head=b"solid of a program".ljust(80)),
}


@pytest.mark.parametrize("data", KINDS.values(), ids=KINDS)
def test_kinds(data):
    check_cube(read(data))


def test_several_solids():
    moved = [[(x + 2, y, z) for x, y, z in t] for t in CORNERS]
    raw = check_cube(read(text(name="") + text(moved, "b")), vertices=16, times=2)
    assert raw.vertices[:, 0].max() == 3


@pytest.mark.parametrize("count", [0, 5, 13, 2**31, 2**32 - 1])
@pytest.mark.parametrize("head", [b"", b"solid of a program".ljust(80)])
def test_a_wrong_count_of_whole_facets(count, head):
    check_cube(read(binary(count, head), f"its header says {count} triangles, but it holds 12"))


def test_a_text_file_without_endsolid():
    check_cube(read(text(end=""), "no 'endsolid'"))
    two = text() + text([[(x + 2, y, z) for x, y, z in t] for t in CORNERS], end="")
    check_cube(read(two, "no 'endsolid'"), vertices=16, times=2)


def test_what_follows_the_facets_is_reported():
    check_cube(read(binary(tail=b"abc"), "more in the file than the 12 triangles"))


@pytest.mark.parametrize(
    "data",
    [
        text(end="")[:-5],
        text(end="facet no"),
        text(end="facet"),
        text()[:-40],
        text() + text()[:-40],
        text().replace("vertex 1 1 1", "vertex 1 1", 1),
        text().replace("vertex 1 1 1", "", 1),
        text().replace("vertex 1 1 1", "vertex 1 1 l", 1),
        binary()[:-1],
        binary(0)[:-1],
        binary(2**32 - 1)[:-1],
        binary(0, tail=b"abc"),
        b"\0" * 34,
    ],
)
def test_truncated_or_damaged_files_are_refused(data):
    with pytest.raises(BadInput, match="^name: "):
        read(data)


# -- triangles that are not finite -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("suffix", "data"),
    [
        (".stl", text(CORNERS + NAN).encode()),
        (".stl", binary(13, facets=CORNERS + NAN)),
        (".obj", (lines([*V, ("inf", 0, 0)], "v ") + lines([(a + 1, b + 1, c + 1) for a, b, c in TRIANGLES], "f ")
                  + "f 1 2 9\n").encode()),
        (".off", ("OFF\n9 13 0\n" + lines([("nan", 0, 0), *V]) + lines([(3, a + 1, b + 1, c + 1) for a, b, c in
                  TRIANGLES]) + "3 1 2 0\n").encode()),
    ],
)  # fmt: skip
@pytest.mark.parametrize("load", [load_mesh, load_geometry])
def test_triangles_that_are_not_finite_are_left_out(tmp_path, suffix, data, load):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(data)
    with collected() as said:
        mesh = load(path)
    assert len(said) == 1 and str(path) in said[0] and "1 of 13 triangles" in said[0]
    assert len(mesh.faces) == 12 and mesh.volume == pytest.approx(1) and np.isfinite(mesh.vertices).all()


def test_a_mesh_without_finite_triangles_is_refused(tmp_path):
    (tmp_path / "a.stl").write_text(text(NAN))
    with pytest.raises(BadInput, match="all 1 triangles have one"):
        load_mesh(tmp_path / "a.stl")


def test_a_file_without_faces_is_a_cloud(tmp_path):
    (tmp_path / "a.off").write_text("OFF\n8 0 0\n" + lines(V))
    (tmp_path / "a.xyz").write_text(lines(V))
    for name in ("a.off", "a.xyz"):
        cloud = load_geometry(tmp_path / name)
        assert isinstance(cloud, PointCloud) and cloud.points.tolist() == [list(v) for v in V]


@pytest.mark.parametrize("name", ["a.stl", "a.off", "a.xyz"])
def test_score_reads_a_file_once(tmp_path, monkeypatch, name):
    path = tmp_path / name
    path.write_text({"a.stl": text(), "a.off": "OFF\n8 0 0\n" + lines(V), "a.xyz": lines(V)}[name])
    reads, read_bytes = [], Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda self: reads.append(self) or read_bytes(self))
    assert len(getattr(load_to_score(str(path)), "faces", [])) == (12 if name == "a.stl" else 0)
    assert reads == [path]
