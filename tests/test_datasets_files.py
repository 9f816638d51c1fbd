"""The user's meshes: found, named, hashed, read lazily."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest
import trimesh
from bench.datasets.files import SUFFIXES, Files

from bench import BadInput, UsageError
from bench.geometry.files import MESH_READERS, save


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    ball = trimesh.creation.icosphere(1)
    for name in ("b.ply", "a.obj", "c.STL", "d.off", "sub/e.ply"):
        target = tmp_path / name
        target.parent.mkdir(exist_ok=True)
        save(ball, target.with_suffix(target.suffix.lower()))
        target.with_suffix(target.suffix.lower()).rename(target)
    (tmp_path / "notes.txt").write_text("not a mesh")
    return tmp_path


def ids(path: object, split: str = "test") -> list[str]:
    return [shape.id for shape in Files(str(path)).shapes(split)]


def test_a_file_a_folder_and_a_pattern(folder):
    assert ids(folder / "b.ply") == ["b"]
    assert ids(folder) == ["a", "b", "c", "d"]
    assert ids(folder / "*.ply") == ["b"]
    assert ids(folder / "**" / "*.ply") == ["b", "e"]
    assert ids(folder / "[ab].*") == ["a", "b"]
    assert ids(os.pathsep.join([str(folder / "sub"), str(folder / "a.obj")])) == ["a", "e"]
    assert ids(os.pathsep.join([str(folder / "a.obj"), str(folder)])) == ["a", "b", "c", "d"]


def test_the_suffixes_are_those_that_can_be_read():
    assert set(SUFFIXES) == set(MESH_READERS)


def test_home_is_expanded(folder, monkeypatch):
    monkeypatch.setenv("HOME", str(folder))
    assert ids("~/sub") == ["e"]


def test_all_shapes_are_read(folder):
    for shape in Files(str(folder)).shapes("test"):
        assert shape.mesh.is_watertight and len(shape.mesh.faces) == 80
        assert shape.framed()[1].radius == pytest.approx(1)


def test_the_train_split_is_empty(folder):
    assert ids(folder, "train") == []


def test_ids_are_unique_and_safe(tmp_path):
    ball = trimesh.creation.icosphere(0)
    names = ["x.ply", "x.obj", "X.off", "a b/ä ?.ply", "a b/_.ply", "x-2.ply"]
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        save(ball, tmp_path / "mesh.ply")
        (tmp_path / "mesh.ply").rename(tmp_path / name)
    found = ids(tmp_path / "**" / "*")
    assert len(found) == len(names)
    assert len({name.lower() for name in found}) == len(names)
    assert all(name.isascii() and set(name) <= set("abcdefghijklmnopqrstuvwxyzX0123456789._-") for name in found)
    assert not any(name.startswith((".", "-")) for name in found)
    assert ids(tmp_path / "**" / "*") == found


@pytest.mark.parametrize(
    ("path", "says"),
    [
        ("", "is empty"),
        ("nowhere", "no such file or folder"),
        ("nowhere/*.ply", "no file matches"),
        ("notes.txt", "unknown suffix '.txt'"),
        ("void", "holds no mesh file"),
        ("*.txt", "holds no mesh file"),
    ],
)
def test_a_wrong_path_is_told_early(folder, monkeypatch, path, says):
    (folder / "void").mkdir()
    monkeypatch.chdir(folder)
    with pytest.raises(UsageError, match="dataset.path") as error:
        Files(path).check()
    assert says in str(error.value) and ".ply .obj .stl .off" in str(error.value)
    with pytest.raises(UsageError):
        list(Files(path).shapes("test"))


def test_check_is_content_with_what_is_there(folder):
    assert Files(str(folder)).check() is None


def test_a_bad_file_fails_alone_and_late(folder):
    (folder / "b.ply").write_bytes((folder / "b.ply").read_bytes()[:-20])
    shapes = {shape.id: shape for shape in Files(str(folder)).shapes("test")}
    with pytest.raises(BadInput, match=r"b\.ply: ends early"):
        _ = shapes["b"].mesh
    assert len(shapes["a"].mesh.faces) == 80


def test_the_state_follows_the_content(folder):
    files = Files(str(folder))
    before = files.state()
    assert list(before) == ["a (a.obj)", "b (b.ply)", "c (c.STL)", "d (d.off)"]
    assert all(len(value) == 64 for value in before.values())
    os.utime(folder / "a.obj")
    assert files.state() == before
    (folder / "a.obj").write_text((folder / "a.obj").read_text() + "# a comment\n")
    after = files.state()
    assert [key for key in before if before[key] != after[key]] == ["a (a.obj)"]


def test_the_state_does_not_depend_on_where_the_files_are(folder, tmp_path_factory):
    other = tmp_path_factory.mktemp("other")
    for file in folder.iterdir():
        if file.is_file():
            (other / file.name).write_bytes(file.read_bytes())
    assert Files(str(other)).state() == Files(str(folder)).state()


def test_the_state_survives_an_unreadable_file(folder, monkeypatch):
    opened = Path.open

    def refuse(self, *args, **options):
        if self.name == "a.obj":
            raise PermissionError(13, "Permission denied")
        return opened(self, *args, **options)

    monkeypatch.setattr(Path, "open", refuse)
    assert Files(str(folder)).state()["a (a.obj)"] == "unreadable (Permission denied)"


def test_a_name_with_the_separator_in_it(tmp_path):
    file = tmp_path / f"left{os.pathsep}right.ply"
    save(trimesh.creation.icosphere(0), tmp_path / "mesh.ply")
    (tmp_path / "mesh.ply").rename(file)
    assert ids(file) == ["left_right"]
    assert stat.S_ISREG(file.stat().st_mode)
