"""Outputs made elsewhere: scored as those of a method, to the bit, and failed in words where they are not whole."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from bench import UsageError
from bench.commands.inputs import read_manifest
from bench.geometry.io.files import load_cloud

TOYS = Path(__file__).parents[1] / "faults" / "toys.py"
SHAPES = ("dataset=cad", "cases=2", "sensor=samples", "sensor.count=800", "seed=0")
METRICS = "metric=[chamfer_l1_mean,normal_angle_deg,topology]"  # some that draw points, and one that does not


@pytest.fixture(scope="module")
def real(shells):
    """A real method with its outputs, the same inputs as files, and its outputs imported."""
    shell = shells("real")
    own = ("method=alpha_shape", METRICS, "outputs=all", f"results={shell.results}")
    shell.first = shell.call("run", "--no-leaderboard", *SHAPES, *own)
    shell.inputs = shell.folder / "inputs"
    shell.written = shell.call("inputs", shell.inputs, *SHAPES, METRICS)
    manifest = read_manifest(shell.inputs)
    for row in shell.rows().to_dict("records"):
        (case,) = (case for case in manifest["cases"] if case["case"] == row["case"])
        shutil.copy(shell.results / row["output"], shell.inputs / case["output"])
    shell.words = ("import", shell.inputs, "--method", "theirs", f"results={shell.results}")
    shell.imported = shell.call(*shell.words)
    shell.table = shell.rows()
    return shell


def test_scores_are_those_of_the_method_to_the_bit(real):
    assert (real.first.returncode, real.written.returncode, real.imported.returncode) == (0, 0, 0), real.imported.stderr
    table = real.table
    scores = [name for name in table if name.startswith(("score.", "floor.", "worst.", "input."))]
    ours, theirs = (table[table["method"] == name].sort_values("case")[scores] for name in ("alpha_shape", "imported"))
    assert len(ours) == len(theirs) == 2 and len(scores) > 10
    np.testing.assert_array_equal(ours.to_numpy(float), theirs.to_numpy(float))


def test_rows_are_marked_and_claim_no_time(real):
    rows = real.table[real.table["method"] == "imported"]
    assert (rows["variant"] == "theirs").all()
    assert rows["external"].str.fullmatch(r"results of theirs, imported on \d{4}-\d\d-\d\d").all()
    empty = ["seconds", "cpu_seconds", "peak_rss_mb", "rss_before_mb", "exchange_seconds", "reference_seconds"]
    assert rows[empty].isna().all(axis=None)
    assert real.table[real.table["method"] == "alpha_shape"]["seconds"].notna().all()


def test_the_leaderboard_marks_them(real):
    board = real.call("leaderboard", real.results, "--format", "markdown").stdout
    (line,) = (line for line in board.splitlines() if line.startswith("| imported (theirs)"))
    assert [cell.strip() for cell in line.split("|")][-3:-1] == ["-", "-"]  # seconds, memory
    terminal = real.call("leaderboard", real.results).stdout
    assert "external: results of theirs, imported on" in terminal


def test_a_second_import_scores_nothing(real):
    assert "0 scored, 2 cached" in real.call(*real.words).stderr


def test_the_inputs_are_the_cases_own(real):
    # The output of a method that changes nothing is its input.
    manifest = read_manifest(real.inputs)
    other = real.folder / "denoised"
    words = ("task=denoise", "method=identity", "outputs=all", "metric=[p2f_mean]")
    real.call("run", "--no-leaderboard", *words, *SHAPES, f"results={other}")
    for case in manifest["cases"]:
        (kept,) = other.glob(f"outputs/*/{case['case']}.ply")
        cloud, same = load_cloud(real.inputs / case["input"]), load_cloud(kept)
        np.testing.assert_array_equal(cloud.points, same.points)
        np.testing.assert_array_equal(cloud.normals, same.normals)
        assert case["points"] == len(cloud) == 800 and case["normals"]


# --- toys: what is not whole ------------------------------------------------------------------------------------------


@pytest.fixture
def toy(shell):
    elsewhere = "device=cuda:99"  # of whoever makes the outputs: this machine only writes and scores files
    words = ("task=denoise", "dataset=ball", "sensor=dots", "metric=[spread]", "cases=4", elsewhere)
    shell.inputs = shell.folder / "inputs"
    done = shell.call("inputs", shell.inputs, "--plugin", TOYS, *words)
    assert done.returncode == 0, done.stderr
    shell.cases = read_manifest(shell.inputs)["cases"]
    for case in shell.cases:
        shutil.copy(shell.inputs / case["input"], shell.inputs / case["output"])
    shell.words = ("import", shell.inputs, "--plugin", TOYS, "--method", "theirs", f"results={shell.results}")
    return shell


def test_what_is_not_whole_is_a_failed_case(toy):
    outputs = [toy.inputs / case["output"] for case in toy.cases]
    outputs[0].unlink()
    outputs[1].write_bytes(outputs[1].read_bytes()[:-100])
    cloud = load_cloud(outputs[2])
    np.savetxt(outputs[2].with_suffix(".xyz"), cloud.points * 1000)
    outputs[2].unlink()
    done = toy.call(*toy.words)
    assert done.returncode == 3, done.stderr
    rows = toy.rows()
    assert list(rows["status"]) == ["invalid", "invalid", "invalid", "ok"]
    said = list(rows["message"])
    assert said[0].startswith(f"there is no output {toy.cases[0]['output']}")
    assert said[1].startswith(toy.cases[1]["output"])
    assert "in another frame than the input" in said[2] and "1,000 times" in said[2]
    assert all(message in done.stderr for message in (said[0], said[2]))
    assert rows["external"].notna().all() and rows["seconds"].isna().all()


def test_a_changed_output_is_scored_again(toy):
    assert "4 scored, 0 cached" in toy.call(*toy.words).stderr
    path = toy.inputs / toy.cases[0]["output"]
    before = toy.rows().set_index("case")["score.spread"]
    cloud = load_cloud(path)
    np.savetxt(path.with_suffix(".xyz"), cloud.points * 2)
    path.unlink()
    assert "4 scored, 0 cached" in toy.call(*toy.words).stderr
    after = toy.rows().set_index("case")["score.spread"]
    assert (before != after).sum() == 1


def test_an_output_of_another_input_is_refused(toy):
    path = toy.inputs / toy.cases[0]["input"]
    shutil.copy(toy.inputs / toy.cases[1]["input"], path)
    toy.call(*toy.words)
    row = toy.rows().iloc[0]
    assert row["status"] == "error" and "no longer matches this case" in row["message"]


def test_two_outputs_of_one_case_are_refused(toy):
    path = toy.inputs / toy.cases[0]["output"]
    np.savetxt(path.with_suffix(".xyz"), load_cloud(path).points)
    toy.call(*toy.words)
    assert "there are 2 outputs" in toy.rows().iloc[0]["message"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("inputs", "there"), "is there and has no manifest.json"),
        (("import", "nowhere", "--method", "x"), "no such file"),
        (("import", "broken", "--method", "x"), "is not a manifest"),
        (("import", "broken", "--method", "../x"), "expected a name"),
        (("import", "outside", "--method", "x"), "is not a manifest"),
    ],
)
def test_mistakes(shell, words, message):
    for name, text in (("there", ""), ("broken", "{}"), ("outside", json.dumps(outside()))):
        (shell.work / name).mkdir()
        (shell.work / name / ("file" if name == "there" else "manifest.json")).write_text(text)
    done = shell.call(*words)
    assert done.returncode == 1 and message in done.stderr


def outside():
    case = {"case": "a", "group": "g", "input": "g/inputs/a.ply", "output": "../../a.ply"}
    return {"format": "detailbench inputs 1", "groups": {"g": {"cell": {}}}, "cases": [case]}


def test_arguments_that_choose_what_to_run_are_refused(toy):
    done = toy.call(*toy.words, "dataset=bumps")
    assert done.returncode == 1 and "the manifest says the rest" in done.stderr


def test_a_manifest_is_checked(tmp_path):
    with pytest.raises(UsageError, match="no such file"):
        read_manifest(tmp_path)
