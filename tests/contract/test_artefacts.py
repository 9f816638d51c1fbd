"""What methods store beside their outputs: by name, in files that others can read, off the clock, within bounds."""

import json
import time

import numpy as np
import pyarrow.parquet as pq
import pytest
import trimesh
from conftest import TOYS
from trimesh.creation import box

import bench.contract.artefacts
from bench import PointCloud, Run, Views
from bench.authoring.conformance import toy_views
from bench.contract.artefacts import Artefacts
from bench.geometry.io.files import load_cloud

KEEPER = TOYS.with_name("silhouettes.py")


def test_keeping_costs_a_method_nothing_without_a_store():
    run = Run()
    run.keep("never_made", lambda: 1 / 0)
    run.keep("mesh", box())
    run.trace(box(), keep=True)
    assert run.notes == []


def test_keeping_takes_no_time_of_the_method():
    kept = []
    run = Run(seconds=10, on_keep=lambda name, value: (time.sleep(0.2), kept.append((name, value))))
    run.keep("first", np.zeros((2, 2), np.uint8))
    assert run.elapsed() < 0.1
    assert [name for name, _ in kept] == ["first"]


NO_NAMES = ["", "a/b", "../a", ".hidden", "-rf", "a\\b", "a b", "a\n", "x" * 65, "ä", "a\0", None]


@pytest.mark.parametrize("name", NO_NAMES)
def test_names_that_are_no_plain_file_names_are_refused(name):
    with pytest.raises(ValueError, match="run.keep: the name .*: expected 1 to 64 letters"):
        Run().keep(name, box())


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (7, "cannot store a int; expected a Trimesh"),
        (np.zeros((4, 4)), r"an array of float64 in the shape \(4, 4\); expected an image of uint8"),
        (np.zeros((4, 4, 2), np.uint8), r"in the shape \(4, 4, 2\)"),
        (np.zeros((0, 4), np.uint8), r"in the shape \(0, 4\)"),
        ({"a": object()}, "cannot store a dict"),
        ({"a/b": np.zeros(3)}, "cannot store a dict"),
        ({"a": np.array([None])}, "cannot store a dict"),
    ],
)
def test_what_cannot_be_stored_is_refused_in_every_run(value, words):
    with pytest.raises(ValueError, match=words):
        Run().keep("thing", value)


def artefacts(tmp_path):
    notes = []
    return Artefacts(tmp_path / "outputs" / "case", tmp_path, notes.append), notes


def test_what_is_stored_can_be_read_by_others(tmp_path):
    from PIL import Image

    files, notes = artefacts(tmp_path)
    mesh, cloud, views = box(), PointCloud(np.eye(3), np.eye(3)), toy_views()
    gray, color = np.arange(12, dtype=np.uint8).reshape(3, 4), np.arange(36, dtype=np.uint8).reshape(3, 4, 3)
    field = {"file": np.arange(3.0), "allow_pickle": np.array(["a"]), "number": 2}
    values = {"mesh": mesh, "cloud": cloud, "gray": gray, "color": lambda: color, "field": field, "views": views}
    for name, value in values.items():
        files.keep(name, value)
    names = ["mesh.ply", "cloud.ply", "gray.png", "color.png", "field.npz", "views.npz"]
    assert files.paths == [f"outputs/case/{name}" for name in names]
    folder = tmp_path / "outputs" / "case"
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)
    assert np.array_equal(trimesh.load(folder / "mesh.ply", process=False).faces, mesh.faces)
    assert np.array_equal(load_cloud(folder / "cloud.ply").normals, cloud.normals)
    assert np.array_equal(np.asarray(Image.open(folder / "gray.png")), gray)
    assert np.array_equal(np.asarray(Image.open(folder / "color.png")), color)
    with np.load(folder / "field.npz") as read:
        values = {name: read[name].tolist() for name in read.files}
        assert values == {"file": [0.0, 1.0, 2.0], "allow_pickle": ["a"], "number": 2}
    with np.load(folder / "views.npz") as read:
        assert np.array_equal(Views.of(read).images, views.images)
    assert notes == []


def test_the_last_value_of_a_name_counts(tmp_path):
    files, _ = artefacts(tmp_path)
    files.keep("state", np.zeros((2, 2), np.uint8))
    files.keep("state", {"x": np.arange(3)})
    assert files.paths == ["outputs/case/state.npz"]
    assert [path.name for path in (tmp_path / "outputs" / "case").iterdir()] == ["state.npz"]


def test_a_case_stores_no_more_than_its_share(tmp_path, monkeypatch):
    monkeypatch.setattr(bench.contract.artefacts, "LIMIT_BYTES", 100)
    files, notes = artefacts(tmp_path)
    image = np.zeros((8, 10), np.uint8)
    assert files.keep("one", image) and files.keep("one", image)  # in place of itself there is room
    assert files.keep("two", image) is None
    assert files.paths == ["outputs/case/one.png"]
    assert notes[0].startswith("run.keep: two was not stored: a case stores at most")


@pytest.mark.parametrize("value", [np.zeros((2, 2), np.uint8), PointCloud(np.eye(3))], ids=["image", "cloud"])
def test_a_folder_that_cannot_be_written_is_a_note(tmp_path, value):
    (tmp_path / "outputs").write_text("a file where the folder should be")
    files, notes = artefacts(tmp_path)
    assert files.keep("thing", value) is None
    assert files.paths == []
    assert notes[0].startswith("run.keep: thing was not stored: ")


@pytest.mark.parametrize("wanted", ["none", "first"])
def test_methods_store_what_the_settings_ask_for(shell, wanted):
    done = shell.run("method=keeps_all", "method.odd=true,false", f"outputs={wanted}", plugins=(TOYS, KEEPER))
    assert done.returncode == 3, done.stderr
    records = [pq.read_table(path).to_pylist() for path in shell.files()]
    odd, good = sorted(records, key=lambda rows: rows[0]["status"] == "ok")
    assert {row["status"] for row in odd} == {"error"}
    assert "cannot store a int" in odd[0]["message"]
    assert all(row["status"] == "ok" and not row["message"] for row in good)
    stores = {"none": 0, "first": 1}[wanted]
    for rows in (odd, good):
        for row in rows[:stores]:  # the odd one failed after it had stored the others
            folder = f"outputs/{row['cell']}-{row['fingerprint']}/{row['case']}"
            names = ["cage.ply", "cloud.ply", "gray.png", "field.npz", "trace-001.ply"]
            assert json.loads(row["artefacts"]) == [f"{folder}/{name}" for name in names]
            assert all((shell.results / path).is_file() for path in json.loads(row["artefacts"]))
            plain, kept = json.loads(row["trace"])
            assert "artefact" not in plain
            assert kept["artefact"] == f"{folder}/trace-001.ply"
            assert kept["seconds"] >= plain["seconds"] > 0
        assert [row["artefacts"] for row in rows[stores:]] == (2 - stores) * [None]
    assert len([*shell.results.glob("outputs/*/*/*")]) == 10 * stores
    assert shell.results.joinpath("outputs").exists() == (stores > 0)


def test_a_method_cannot_write_elsewhere(shell):
    words = ("method=keeps_all", "method.name='../../evil'", "outputs=all", "cases=1")
    done = shell.run(*words, sweep=False, plugins=(TOYS, KEEPER))
    assert done.returncode == 3, done.stderr
    assert "the name '../../evil': expected 1 to 64 letters" in shell.rows()["message"][0]
    assert not list(shell.folder.rglob("*evil*"))


def test_apply_stores_nothing(shell):
    from bench.geometry.io.files import save

    save(PointCloud(np.random.default_rng(0).normal(size=(20, 3))), shell.work / "in.ply")
    done = shell.apply("--plugin", KEEPER, "method=keeps_all", "in.ply", "out.ply")
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in shell.work.iterdir()) == ["in.ply", "out.ply"]


def test_results_without_the_column_are_read(shell):
    """Those of earlier versions."""
    from bench.results.store import Results

    shell.run("method=fine", "cases=1", sweep=False)
    (path,) = shell.files()
    pq.write_table(pq.read_table(path).drop_columns(["artefacts"]), path)
    assert len(Results(shell.results).rows()) == 1
    done = shell.run("method=fine", "cases=1", sweep=False)
    assert "1 cached" in done.stderr
    assert shell.call("leaderboard", shell.results).returncode == 0
