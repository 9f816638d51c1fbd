"""The user's meshes: found, named, hashed, and read lazily."""

from __future__ import annotations

import hashlib
import os
import stat
from pathlib import Path

import pytest
import trimesh

from bench import BadInput, PointCloud, UsageError
from bench.datasets.files import SUFFIXES, Files
from bench.geometry.io.files import MESH_READERS, save
from bench.plan.cell import Choice
from bench.plugins.registry import registry
from bench.plugins.schema import parameters


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
    return ids_of(Files(str(path)), split)


def ids_of(files: Files, split: str) -> list[str]:
    return [shape.id for shape in files.shapes(split)]


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


def test_without_train_files_the_error_of_the_train_split_gives_advice(folder):
    with pytest.raises(
        UsageError, match=r"split=train has no meshes.*dataset\.train_path=FOLDER.*train_share"
    ) as error:
        ids(folder, "train")
    assert str(folder) in str(error.value)
    with pytest.raises(UsageError, match="train_path"):
        Files(str(folder)).check("train")


@pytest.fixture
def two_folders(tmp_path: Path) -> tuple[Path, Path]:
    """Folders with a, b and a, c: four meshes with different contents."""
    for size, name in enumerate(("test/a.ply", "test/b.ply", "train/a.ply", "train/c.ply"), 1):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        save(trimesh.creation.icosphere(1, radius=size), tmp_path / name)
    return tmp_path / "test", tmp_path / "train"


def test_a_second_folder_is_the_train_split(two_folders):
    test, train = two_folders
    files = Files(str(test), train_path=str(train))
    assert [s.id for s in files.shapes("test")] == ids(test) == ["a", "b"]
    assert [s.id for s in files.shapes("train")] == ["a-2", "c"]  # unique over both: reference files are named by id
    assert [round(float(s.mesh.vertices.max()), 1) for s in files.shapes("train")] == [3.0, 4.0]
    files.check("test"), files.check("train")
    assert list(files.state()) == ["a (a.ply)", "b (b.ply)", "a-2 (a.ply)", "c (c.ply)"]
    assert files.state() == {**Files(str(test)).state(), **files.state()}  # test meshes keep their ids
    before = files.state()
    save(trimesh.creation.icosphere(1, radius=9), train / "c.ply")
    assert [key for key in before if files.state()[key] != before[key]] == ["c (c.ply)"]


def test_a_mesh_in_both_splits_is_refused_with_both_names(two_folders):
    test, train = two_folders
    (train / "another.ply").write_bytes((test / "b.ply").read_bytes())
    files = Files(str(test), train_path=str(train))
    for use in (files.check, lambda: list(files.shapes("test")), lambda: list(files.shapes("train"))):
        with pytest.raises(UsageError, match="same content") as error:
            use()
        assert str(test / "b.ply") in str(error.value) and str(train / "another.ply") in str(error.value)


def test_the_error_of_a_wrong_train_path_names_that_parameter(folder):
    with pytest.raises(UsageError, match=r"dataset\.train_path=nowhere: no such file"):
        Files(str(folder), train_path="nowhere").check("test")


def test_the_train_share_is_chosen_by_content_alone(tmp_path):
    for number in range(40):
        (tmp_path / f"{number:02d}.off").write_bytes(b"%d" % number)
    splits = {split: ids_of(Files(str(tmp_path), train_share=0.3), split) for split in ("test", "train")}
    assert sorted(splits["test"] + splits["train"]) == ids(tmp_path)
    expected = [f"{n:02d}" for n in range(40) if int(hashlib.sha256(b"%d" % n).hexdigest(), 16) / 2**256 < 0.3]
    assert splits["train"] == expected and 5 < len(expected) < 20
    # Neither names nor other files matter: a renamed file stays in its split; a larger share includes a smaller one.
    for number in range(20):
        (tmp_path / f"{number:02d}.off").unlink()
    (tmp_path / "39.off").rename(tmp_path / "other.off")
    again = ids_of(Files(str(tmp_path), train_share=0.3), "train")
    assert {"other" if name == "39" else name for name in expected if name >= "20"} == set(again)
    assert set(again) <= set(ids_of(Files(str(tmp_path), train_share=0.7), "train"))


def test_copies_stay_in_one_split(tmp_path):
    for name in ("a", "b", "c"):
        (tmp_path / f"{name}.off").write_bytes(b"the same")
    for share in (0.1, 0.5, 0.9):
        files = Files(str(tmp_path), train_share=share)
        found = {split for split in ("test", "train") for found in files._named().values() if found.split == split}
        assert len(found) == 1


def test_a_share_that_leaves_nothing_is_refused(folder):
    with pytest.raises(UsageError, match=r"train_share=1 leaves none of the 4 mesh files .* to the split test"):
        Files(str(folder), train_share=1.0).check("test")
    Files(str(folder), train_share=1.0).check("train")


@pytest.mark.parametrize("given", [{"train_share": 1.5}, {"train_share": 0.5, "train_path": "x"}])
def test_a_share_out_of_range_or_together_with_a_folder_is_refused(given):
    with pytest.raises(ValueError, match="train_share"):
        Files("x", **given)


def test_cells_without_the_train_parameters_keep_their_ids(folder):
    """The id is that of a cell whose dataset has only the parameter path."""
    plugin = registry().find("dataset", "files")
    assert parameters(plugin, Files("x")) == {"path": "x"}
    assert parameters(plugin, Files("x", train_share=0.25)) == {"path": "x", "train_share": 0.25}
    choice = Choice.of("dataset", {"_name_": "files", "path": "x", "train_path": "", "train_share": 0})
    assert choice == Choice("dataset", "files", {"path": "x"})
    assert choice.build() == Files("x")
    assert choice.label == "files[path=x]"


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
def test_a_wrong_path_is_reported_early(folder, monkeypatch, path, says):
    (folder / "void").mkdir()
    monkeypatch.chdir(folder)
    with pytest.raises(UsageError, match="dataset.path") as error:
        Files(path).check()
    assert says in str(error.value) and ".ply .obj .stl .off" in str(error.value)
    with pytest.raises(UsageError):
        list(Files(path).shapes("test"))


def test_check_accepts_existing_files(folder):
    assert Files(str(folder)).check() is None


def test_a_bad_file_fails_alone_when_it_is_read(folder):
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


def test_a_name_that_contains_the_path_separator(tmp_path):
    file = tmp_path / f"left{os.pathsep}right.ply"
    save(trimesh.creation.icosphere(0), tmp_path / "mesh.ply")
    (tmp_path / "mesh.ply").rename(file)
    assert ids(file) == ["left_right"]
    assert stat.S_ISREG(file.stat().st_mode)


def paired(**own: object) -> list[tuple[str, str, str]]:
    pairs = Files(**own).pairs("test")  # type: ignore[arg-type]
    return [(pair.id, pair.source.info["file"], pair.target.info["file"]) for pair in pairs]


def test_pairs_are_successive_files_or_files_of_the_same_name(folder, tmp_path):
    three = str(folder / "[abd].*")
    assert paired(path=three) == [
        ("a-to-b", "a.obj", "b.ply"),
        ("b-to-d", "b.ply", "d.off"),
        ("d-to-a", "d.off", "a.obj"),
    ]
    targets = tmp_path / "targets"
    targets.mkdir()
    for name in ("b.obj", "a.ply"):
        save(trimesh.creation.box(), targets / name)
    both = {"path": str(folder / "[ab].*"), "target_path": str(targets)}
    assert paired(**both) == [("a-to-a", "a.obj", "a.ply"), ("b-to-b", "b.ply", "b.obj")]
    single = paired(path=three, target_path=str(targets / "b.obj"))
    assert [target for _, _, target in single] == ["b.obj"] * 3
    before = Files(**both).state()
    save(trimesh.creation.icosphere(1), targets / "b.obj")
    assert before != Files(**both).state()


def test_pairs_without_targets_are_refused(folder, tmp_path):
    with pytest.raises(UsageError, match=r"a pair takes two meshes, but dataset.path=.*b.ply has one; name targets"):
        paired(path=str(folder / "b.ply"))
    targets = tmp_path / "targets"
    targets.mkdir()
    for name in ("a.ply", "x.ply"):
        save(trimesh.creation.box(), targets / name)
    with pytest.raises(UsageError, match="has no mesh named b "):
        paired(path=str(folder / "[ab].*"), target_path=str(targets))
    with pytest.raises(UsageError, match="target_path: pairs with targets of their own are test data"):
        list(Files(str(folder / "a.obj"), train_path=str(folder / "b.ply"), target_path=str(targets)).pairs("train"))


def test_pairs_make_cases_of_deform(folder, tmp_path):
    from bench.tasks.deform import Deform

    save(trimesh.creation.box(), tmp_path / "box.ply")

    def recipe(target: Path, **own: bool):
        files = Files(str(folder / "a.obj"), target_path=str(target), **own)
        (only,) = Deform(vertices=0).recipes(files, None, split="test", count=9, seed=0)
        return only

    case = recipe(tmp_path / "box.ply").build()
    assert len(case.input["source"].faces) == 80 and len(case.reference.mesh.faces) == 12
    with pytest.raises(BadInput, match=r"a.obj \(80 faces\) and box.ply \(12 faces\) do not have the same faces"):
        recipe(tmp_path / "box.ply", corresponding=True).build()
    assert len(recipe(folder / "b.ply", corresponding=True).build().reference.mesh.faces) == 80


def test_the_error_for_point_files_names_the_right_dataset(folder, tmp_path):
    (folder / "scan.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n")
    (folder / "lone").mkdir()
    (folder / "lone" / "scan.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n")
    assert ids(folder) == ["a", "b", "c", "d"]
    says = "1 files of points left out (scan.xyz); use dataset=paired for scans"
    assert Files(str(folder)).ignored() == Files(str(folder / "*")).ignored() == says
    assert Files(str(folder / "*.ply")).ignored() == ""
    for path in (folder / "scan.xyz", folder / "lone", folder / "lone" / "*"):
        with pytest.raises(UsageError, match=r"dataset=paired.*detailbench apply method=NAME IN OUT"):
            ids(path)
    save(PointCloud(trimesh.creation.icosphere(1).vertices), folder / "b.ply")
    shapes = {shape.id: shape for shape in Files(str(folder)).shapes("test")}
    with pytest.raises(BadInput, match=r"b.ply: has 42 vertices but no faces; .*dataset=paired"):
        _ = shapes["b"].mesh
    assert len(shapes["a"].mesh.faces) == 80


def test_the_number_of_shapes(two_folders):
    test, train = two_folders
    files = Files(str(test), train_path=str(train))
    assert (files.count("test"), files.count("train"), Files(str(test)).count("train")) == (2, 2, 0)


def test_the_state_of_a_gltf_covers_its_buffer_file(tmp_path):
    for name in ("a", "b"):
        for file, data in trimesh.creation.box().export(file_type="gltf").items():
            (tmp_path / file.replace("model", name)).write_bytes(data)
    buffer = tmp_path / "gltf_buffer_0.bin"
    before = Files(path=str(tmp_path)).state()
    places = bytearray(buffer.read_bytes())
    places[-1] ^= 1
    buffer.write_bytes(places)
    after = Files(path=str(tmp_path)).state()
    assert len(before) == 2 and before.keys() == after.keys() and not set(before.values()) & set(after.values())
    (tmp_path / "a.gltf").write_text("{")
    assert Files(path=str(tmp_path)).state().keys() == before.keys()
