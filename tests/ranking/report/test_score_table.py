"""The table of one output's scores: its columns, its numbers, and what is said of them."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from bench import PointCloud
from bench.ranking.report.score_table import Score, score_table, words
from bench.ranking.report.terminal import NOTES

CASE = SimpleNamespace(frame=SimpleNamespace(radius=50.0), seed=7)
SCORES = {
    "p2f_mean": Score(0.0123456, 0.00012, "lower", 1),
    "iou": Score(0.5, None, "higher"),
    "genus": Score(math.inf, 1.0, "reference"),
}


def test_each_score_has_its_value_its_floor_and_its_direction():
    lines = score_table(SCORES, CASE, 20_000, {}).splitlines()
    assert [line.split() for line in (lines[0], *lines[2:5])] == [
        ["score", "value", "floor", "better"],
        ["p2f_mean", "0.01235", "0.00012", "lower"],
        ["iou", "0.5", "higher"],
        ["genus", "inf", "1", "nearest", "the", "reference's"],
    ]
    assert lines[5:] == [
        "",
        "Lengths are in radii of the reference: 1 is 50 in the files' coordinates.",
        "Unless a metric sets another number, 20,000 points are sampled from a surface; seed 7.",
    ]
    ends = {title: lines[0].index(title) + len(title) for title in ("value", "floor")}
    assert lines[2][: ends["value"]].endswith(" 0.01235") and lines[2][: ends["floor"]].endswith(" 0.00012")
    assert lines[4][: ends["value"]].endswith(" inf") and lines[4][: ends["floor"]].endswith(" 1")


def test_lengths_in_the_units_of_the_files_are_said_to_be():
    text = score_table(SCORES, CASE, 100, {}, units="file")
    assert "Lengths are in the units of the files; thresholds in radii of the reference: 1 is 50." in text
    assert "Lengths are in radii" not in text


def test_a_convention_sets_digits_and_adds_its_notes():
    convention = SimpleNamespace(digits={"CD": 2, "NC": 3}, notes=lambda names: [f"of {', '.join(names)}"])
    scores = {"CD": Score(1.0, 0.126, "lower"), "NC": Score(math.nan, None, "higher")}
    lines = score_table(scores, CASE, 100, {}, convention).splitlines()
    assert lines[2].split() == ["CD", "1.00", "0.13", "lower"] and lines[3].split() == ["NC", "nan", "higher"]
    assert lines[-1] == "of CD, NC"


def test_what_has_no_score_is_named_with_the_reason_and_a_long_path_stays_whole():
    path = "p" * (NOTES + 20)
    text = score_table(SCORES, CASE, 100, {"iou": f"takes {'closed ' * 20}surfaces: {path}"})
    note = text.splitlines()[8:]  # below the table and two sentences
    assert note[0].startswith("no score: iou takes closed") and note[-1] == f"  {path}"
    assert all(line.startswith("  ") for line in note[1:]) and max(map(len, note[:-1])) <= NOTES


@pytest.mark.parametrize(
    ("geometry", "said"),
    [
        (trimesh.creation.icosphere(3), "1,280 faces, 642 vertices"),
        (trimesh.Trimesh(np.zeros((3000, 3)), process=False), "3,000 points"),
        (PointCloud(np.zeros((1500, 3))), "1,500 points"),
    ],
)
def test_the_size_of_a_mesh_and_of_a_cloud(geometry, said):
    assert words(geometry) == said
