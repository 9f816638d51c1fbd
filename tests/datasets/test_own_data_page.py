"""The commands of docs/own-data.md: each is planned, or scored, as printed, on files with the names in it."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.io import savemat

from bench import PointCloud
from bench.cli import main
from bench.geometry.io.files import save

PAGE = Path(__file__).resolve().parents[2] / "docs" / "own-data.md"
BLOCKS = re.findall(r"```sh\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
COMMANDS = [line for block in BLOCKS for line in block.splitlines()]
FILES = (
    "meshes/a.ply scans/a_noisy.xyz truth/a.ply data/scans/a.ply data/truth/a.ply sparse/a.ply "
    "noisy/examples/PUNet_10000_poisson_0.02/a.xyz noisy/examples/PUNet_50000_poisson_0.01/a.xyz "
    "noisy/PUNet/meshes/test/a.off deep_geometric_prior_data/scans/a.ply deep_geometric_prior_data/ground_truth/a.xyz "
    "mvs024.ply stl024_total.ply output.ply reference.ply"
)
OF_DTU = ("Points/furu/furu024_l3.ply", "Points/stl/stl024_total.ply")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own data")
    ball = trimesh.creation.icosphere(2)
    for name in [*FILES.split(), *(f"SampleSet/MVS Data/{name}" for name in OF_DTU)]:
        save(PointCloud(ball.vertices) if name.endswith("xyz") else ball, folder / name)
    mask = {"ObsMask": np.ones((3, 3, 3)), "BB": [[-1.0] * 3, [1.0] * 3], "Res": 1.0}
    (folder / "SampleSet/MVS Data/ObsMask").mkdir()
    for place in (folder, folder / "SampleSet/MVS Data/ObsMask"):
        savemat(place / "ObsMask24_10.mat", mask)
        savemat(place / "Plane24.mat", {"P": [[0.0, 0.0, 1.0, 2.0]]})
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_works_as_printed(folder, monkeypatch, capsys, command):
    monkeypatch.chdir(folder)
    name, act, *words = shlex.split(command)
    assert name == "detailbench" and act in ("run", "plan", "score")
    assert main([act.replace("run", "plan"), *words]) == 0, capsys.readouterr().err
    shown = capsys.readouterr().out
    assert "not planned" not in shown
    if act != "score":
        assert re.search(r"^\d+ cells?, \d+ cases?, 0 finished", shown, re.MULTILINE), shown
