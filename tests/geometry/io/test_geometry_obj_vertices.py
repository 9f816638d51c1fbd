"""OBJ files with new coordinates: what stays, what is recomputed, and what is refused."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from bench import BadInput, UsageError
from bench.geometry.io.files import load_mesh
from bench.geometry.io.obj_vertices import save_with_vertices

# A box of quadrangles as a modelling program writes it: one vertex normal a side, three groups, two materials.
BOX = """\
# made by hand
mtllib box.mtl
o Box
v -1.0 -1.0 -1.0
v 1 -1 -1 0.5 0.25 0.125
v 1 1 -1
v -1 1 -1   # the fourth
v -1 -1 1
v 1 -1 1
v 1 1 1
v -1 1 1
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 -1
vn 0 0 1
vn 0 -1 0
vn 1 0 0
vn 0 1 0
vn -1 0 0
g lids
usemtl wood
s 1
f 1/1/1 4/2/1 3/3/1 2/4/1
f 5/1/2 6/2/2 7/3/2 8/4/2
g walls
usemtl iron
s off
f 1/1/3 2/2/3 6/3/3 5/4/3
f -7/1/4 -6/2/4 -2/3/4 -3/4/4

f 3//-2 4//-2 8//-2 7//-2
f 4//6 1//6 5//6
f 4//6 5//6 8//6
"""


@pytest.fixture
def box(tmp_path: Path) -> Path:
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "box.mtl").write_text("newmtl wood\nnewmtl iron\n")
    path = tmp_path / "models" / "box.obj"
    path.write_text(BOX)
    return path


def words(path: Path, *keywords: str) -> list[list[str]]:
    """The words of the lines that begin with one of the keywords."""
    return [line.split() for line in path.read_text().splitlines() if line.split()[:1] in [[k] for k in keywords]]


def written(source: Path, vertices: np.ndarray, name: str = "out.obj") -> Path:
    path = source.with_name(name)
    save_with_vertices(source, vertices, path)
    return path


def test_only_lines_of_vertices_and_normals_change(box):
    mesh = load_mesh(box)
    new = mesh.vertices * (1, 2, 3) + (0.1, 0.2, 0.3)
    out = written(box, new)
    before, after = BOX.splitlines(), out.read_text().splitlines()
    assert len(before) == len(after)
    for old, line in zip(before, after, strict=True):
        assert old == line or old.split()[0] == line.split()[0] and old.split()[0] in ("v", "vn")
    read = load_mesh(out)
    assert np.array_equal(read.vertices, new) and np.array_equal(read.faces, mesh.faces)
    assert sorted(p.name for p in box.parent.iterdir()) == ["box.mtl", "box.obj", "out.obj"]


def test_what_follows_the_coordinates_stays(box):
    rows = words(written(box, np.zeros((8, 3))), "v")
    assert rows[1] == ["v", "0", "0", "0", "0.5", "0.25", "0.125"] and rows[3] == [
        "v",
        "0",
        "0",
        "0",
        "#",
        "the",
        "fourth",
    ]


def test_coordinates_come_back_bit_for_bit(box):
    new = np.random.default_rng(0).normal(size=(8, 3)) * 10.0 ** np.arange(-12, 12).reshape(8, 3)
    assert np.array_equal(load_mesh(written(box, new)).vertices, new)


# -- normals -----------------------------------------------------------------------------------------------------------


def normals(path: Path) -> np.ndarray:
    return np.array([row[1:] for row in words(path, "vn")], dtype=float)


def test_normals_turn_with_the_mesh(box):
    turn = trimesh.transformations.rotation_matrix(1.1, [1, 2, 3])[:3, :3]
    new = 3 * load_mesh(box).vertices @ turn.T
    assert np.abs(normals(written(box, new)) - normals(box) @ turn.T).max() < 1e-8


def test_the_normal_of_a_sheared_side_is_that_of_its_plane(box):
    shear = np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 2]])
    expected = normals(box) @ np.linalg.inv(shear)  # normals transform by the inverse transpose
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert np.abs(normals(written(box, load_mesh(box).vertices @ shear.T)) - expected).max() < 1e-8


def test_a_normal_of_several_faces_is_their_mean_by_area(tmp_path):
    source = tmp_path / "roof.obj"
    source.write_text("v 0 0 0\nv 0 1 0\nv 1 0 0\nv -2 0 0\nvn 0 0 1\nvn 9 9 9\nf 1//1 3//1 2//1\nf 1//1 2//1 4//1\n")
    ridge = np.array([[0, 0, 1], [0, 1, 1], [1, 0, 0], [-2, 0, 0]], dtype=float)
    out = written(source, ridge)
    total = np.cross(ridge[2] - ridge[0], ridge[1] - ridge[0]) + np.cross(ridge[1] - ridge[0], ridge[3] - ridge[0])
    found = normals(out)
    assert np.abs(found[0] - total / np.linalg.norm(total)).max() < 1e-8
    assert np.array_equal(found[1], [9, 9, 9])  # no face has it


def test_a_polygon_that_is_not_convex_has_the_normal_of_its_plane(tmp_path):
    source = tmp_path / "arrow.obj"
    source.write_text("v 0 0 0\nv 2 -1 0\nv 1 0 0\nv 2 1 0\nvn 0 0 1\nf 2//1 3//1 4//1 1//1\n")
    tilted = load_mesh(source).vertices @ np.array([[1, 0, 1], [0, 1, 0], [0, 0, 1]])
    assert np.abs(normals(written(source, tilted)) - np.array([-1, 0, 1]) / np.sqrt(2)).max() < 1e-8


@pytest.mark.parametrize("corner", ["1//7", "1//-9", "1/1/0"])
def test_references_to_missing_normals_are_accepted(tmp_path, corner):
    source = tmp_path / "a.obj"
    source.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf {corner} 2//1 3//1\n")
    mesh = load_mesh(source)
    assert np.abs(normals(written(source, mesh.vertices[:, [1, 2, 0]])) - (0, 1, 0)).max() < 1e-8
    assert np.array_equal(load_mesh(source.with_name("out.obj")).faces, mesh.faces)


def test_a_file_without_normals_gets_none(tmp_path):
    source = tmp_path / "a.obj"
    source.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert written(source, np.eye(3)).read_text() == "v 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n"


# -- materials ---------------------------------------------------------------------------------------------------------


def materials_of(path: Path) -> list[str]:
    return [line.split(maxsplit=1)[1] for line in path.read_text().splitlines() if line.split()[:1] == ["mtllib"]]


def test_material_files_are_found_from_another_folder(box, tmp_path, monkeypatch):
    (tmp_path / "results" / "deep").mkdir(parents=True)
    out = tmp_path / "results" / "deep" / "out.obj"
    save_with_vertices(box, np.eye(8, 3), out)
    assert materials_of(out) == [os.path.join("..", "..", "models", "box.mtl")]
    assert (out.parent / materials_of(out)[0]).read_text().startswith("newmtl wood")
    # And back again, and from names that are relative to where the program runs.
    save_with_vertices(out, np.eye(8, 3), box.with_name("again.obj"))
    assert materials_of(box.with_name("again.obj")) == ["box.mtl"]
    monkeypatch.chdir(tmp_path)
    save_with_vertices("models/box.obj", np.eye(8, 3), "here.obj")
    assert materials_of(tmp_path / "here.obj") == ["models/box.mtl"]


def test_several_material_files_and_names_with_blanks(box, tmp_path):
    box.with_name("old oak.mtl").write_text("newmtl oak\n")
    box.write_text(BOX.replace("mtllib box.mtl", "mtllib old oak.mtl\n  mtllib\tbox.mtl steel.mtl"))
    out = tmp_path / "out.obj"
    save_with_vertices(box, np.eye(8, 3), out)
    assert materials_of(out) == ["models/old oak.mtl", "models/box.mtl models/steel.mtl"]


def test_absolute_names_of_material_files(box, tmp_path):
    box.write_text(BOX.replace("box.mtl", str(tmp_path / "models" / "box.mtl")))
    out = tmp_path / "out.obj"
    save_with_vertices(box, np.eye(8, 3), out)
    assert (out.parent / materials_of(out)[0]).samefile(tmp_path / "models" / "box.mtl")


# -- odd files ---------------------------------------------------------------------------------------------------------


def test_continued_lines(tmp_path):
    source = tmp_path / "a.obj"
    source.write_text("v 0 0 \\\n0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 \\\n3//1 4//1\n")
    assert len(load_mesh(source).faces) == 2
    out = written(source, load_mesh(source).vertices[:, [2, 0, 1]])
    read = load_mesh(out)
    assert np.array_equal(read.vertices, [[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]]) and len(read.faces) == 2
    assert np.array_equal(normals(out), [[1, 0, 0]])


def test_line_ends_and_encodings_of_other_systems(tmp_path):
    source = tmp_path / "a.obj"
    source.write_bytes(b"# caf\xe9\r\nusemtl caf\xe9\r\nv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3\r\n")
    out = written(source, np.eye(3))
    assert b"usemtl caf\xe9" in out.read_bytes()
    assert np.array_equal(load_mesh(out).vertices, np.eye(3))


def test_a_file_may_overwrite_itself(box):
    new = load_mesh(box).vertices * 2
    save_with_vertices(box, new, box)
    assert np.array_equal(load_mesh(box).vertices, new) and materials_of(box) == ["box.mtl"]


# -- what is refused ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [0, 7, 9])
def test_a_different_number_of_vertices(box, count):
    with pytest.raises(BadInput, match=f"box.obj: has 8 vertices; expected the {count} of the mesh to be written"):
        written(box, np.zeros((count, 3)))
    assert not box.with_name("out.obj").exists()


def test_a_source_that_cannot_be_read(tmp_path):
    with pytest.raises(BadInput, match=r"gone.obj: cannot be read \(No such file"):
        written(tmp_path / "gone.obj", np.zeros((8, 3)))


def test_a_place_that_cannot_be_written_to(box, tmp_path):
    (tmp_path / "folder.obj").mkdir()
    (tmp_path / "file").touch()
    for path in (tmp_path / "nowhere" / "out.obj", tmp_path / "folder.obj", tmp_path / "file" / "out.obj"):
        with pytest.raises(UsageError, match="out.obj: cannot be written|folder.obj: cannot be written"):
            save_with_vertices(box, np.zeros((8, 3)), path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder.obj", "models"]
