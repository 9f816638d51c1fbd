"""``detailbench score --save``: the output with its distances to the reference, as another program reads them."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

from bench import PointCloud
from bench.cli import main
from bench.geometry.io.files import load_cloud, load_mesh, save
from bench.pictures.colors import ERROR

QUICK = ("--metric", "p2f_mean", "--samples", "500")
CENTER = np.array([100.0, 200.0, 300.0])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A ball of radius 50, and an output whose upper half is 2 outside of it."""
    folder = tmp_path_factory.mktemp("files")
    ball = trimesh.creation.icosphere(3)
    far = ball.vertices[:, 2:] > 0
    save(trimesh.Trimesh(ball.vertices * 50 + CENTER, ball.faces, process=False), folder / "reference.ply")
    mesh = trimesh.Trimesh(ball.vertices * np.where(far, 52, 50) + CENTER, ball.faces, process=False)
    save(mesh, folder / "output.ply")
    save(PointCloud(mesh.vertices, ball.vertices, scalars={"time": far[:, 0]}), folder / "cloud.ply")
    return folder


def table(path):
    """The vertices as trimesh reads them, which shares no code with our writer."""
    return trimesh.load(path, process=False).metadata["_ply_raw"]["vertex"]["data"]


def test_a_mesh_keeps_its_shape_and_has_distances_and_colours(files, tmp_path, capsys):
    target = tmp_path / "errors.ply"
    assert main(["score", str(files / "output.ply"), str(files / "reference.ply"), *QUICK, "--save", str(target)]) == 0
    text = capsys.readouterr().out
    assert f"{target}: 642 distances to the reference" in text and "dark is 2 (--limit) and beyond" in text
    before, after = load_mesh(files / "output.ply"), load_mesh(target)
    assert np.array_equal(before.vertices, after.vertices) and np.array_equal(before.faces, after.faces)
    found = table(target)
    far = before.vertices[:, 2] > CENTER[2]
    assert found["distance"] == pytest.approx(np.where(far, 2.0, 0.0), abs=1e-5)
    shown = np.stack([found[name] for name in ("red", "green", "blue")], axis=1)
    assert (shown[~far] == ERROR[0]).all() and (shown[far] == ERROR[255]).all()


def test_the_limit_is_the_dark_end(files, tmp_path, capsys):
    target = tmp_path / "errors.ply"
    words = ["score", str(files / "output.ply"), str(files / "reference.ply"), *QUICK, "--save", str(target)]
    assert main([*words, "--limit", "4", "--json"]) == 0
    errors = json.loads(capsys.readouterr().out)["errors"]
    assert errors == {
        "file": str(target), "count": 642, "limit": 4.0, "beyond": 0.0, "largest": pytest.approx(2),
    }  # fmt: skip
    found = table(target)
    assert set(found["red"][found["distance"] > 1]) <= {ERROR[127][0], ERROR[128][0]}  # 127.5, rounded


def test_a_cloud_keeps_normals_and_scalars(files, tmp_path):
    target = tmp_path / "errors.ply"
    words = ["score", str(files / "cloud.ply"), str(files / "reference.ply"), "--metric", "p2f_mean"]
    assert main([*words, "--save", str(target)]) == 0
    before, after = load_cloud(files / "cloud.ply"), load_cloud(target)
    assert np.array_equal(before.points, after.points) and np.allclose(before.normals, after.normals)
    assert np.array_equal(after.scalars["time"], before.scalars["time"]) and set(after.scalars) == {"distance", "time"}
    assert after.scalars["distance"] == pytest.approx(2 * after.scalars["time"], abs=1e-5)


def test_a_cloud_is_the_reference(files, tmp_path, capsys):
    target = tmp_path / "errors.ply"
    words = ["score", str(files / "output.ply"), str(files / "cloud.ply"), "--metric", "chamfer_l1_mean"]
    assert main([*words, "--save", str(target)]) == 0
    assert table(target)["distance"].max() < 1e-9  # the vertices are its points
    assert "All are 0, so there is one colour." in capsys.readouterr().out


@pytest.mark.parametrize(
    "words, message",
    [
        (["--save", "errors.obj"], "ends in .ply"),
        (["--limit", "2"], "--save FILE.ply, which is not given"),
        (["--save", "errors.ply", "--limit", "0"], "a distance above 0"),
        (["--save", "{output}"], "is a file that is scored"),
    ],
)
def test_mistakes_are_reported_before_anything_is_computed(files, tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    words = [word.format(output=files / "output.ply") for word in words]
    assert main(["score", str(files / "output.ply"), str(files / "reference.ply"), *words]) == 1
    assert message in capsys.readouterr().err and not list(tmp_path.iterdir())
