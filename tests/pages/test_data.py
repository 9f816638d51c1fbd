"""What a page is made of: the numbers of the leaderboard, as JSON that no text breaks."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pandas as pd
import pytest
from boards import row
from boards import rows as rows_of
from made_results import HOSTILE, METHODS

from bench.pages.assemble import one_file
from bench.pages.boards import CONTENDER, GROUP
from bench.pages.data import command_of, page_data
from bench.pages.encoding import columns, number, script_json
from bench.pages.thesis import status_of
from bench.ranking.leaderboard import leaderboard
from bench.ranking.report import render


def test_numbers_are_json():
    assert [number(x) for x in (1.0, 0.25, -3, None, math.nan, pd.NA, np.int64(7), True)] == [
        1, 0.25, -3, None, None, None, 7, 1,
    ]  # fmt: skip
    assert (number(math.inf), number(-math.inf)) == ("Infinity", "-Infinity")
    assert number(1 / 3) == pytest.approx(1 / 3, rel=1e-8)
    assert json.loads(script_json([number(x) for x in (1e300, 1e-300, 2.0**60)])) == [
        1e300,
        1e-300,
        pytest.approx(2.0**60),
    ]


def test_columns_come_back():
    frame = pd.DataFrame({"text": ["b", "a", None, "b"], "value": [1.5, math.nan, 2, 3], "none": [None] * 4})
    packed = columns(frame)
    unpacked = [packed["text"]["values"][code] for code in packed["text"]["codes"]]
    assert unpacked == ["b", "a", "", "b"]
    assert packed["value"] == [1.5, None, 2, 3]
    assert packed["none"] == {"values": [""], "codes": [0, 0, 0, 0]}


@pytest.mark.parametrize("text", [HOSTILE, "</SCRIPT >", "<!--<script>", "\u2028\u2029", "a\0b", "\udcff", "\\u003c"])
def test_no_text_ends_the_script(text):
    made = script_json({"message": text, text: 1})
    assert not re.search(r"[<>&\u2028\u2029]", made)
    made.encode("utf-8")
    back = json.loads(made)
    if "\0" not in text and "\udcff" not in text:  # which UTF-8 cannot hold, and are shown in words
        assert back == {"message": text, text: 1}


def test_nan_is_refused_rather_than_written():
    with pytest.raises(ValueError):
        script_json([math.nan])


def test_the_tables_are_those_of_the_leaderboard(small, small_data):
    rows = small.rows(use_index=False)
    ways = [way["name"] for way in small_data["ways"]]
    assert ways == ["task", "dataset", "sensor", "dataset,sensor", "tag"]
    for way in ways:
        board = leaderboard(rows, by=way)
        groups = [group for group in small_data["groups"] if group["by"] == way]
        assert [tuple(g[name] for name in GROUP) for g in groups] == list(
            dict.fromkeys(board[list(GROUP)].itertuples(index=False, name=None))
        )
        for group in groups:
            mine = board[(board[list(GROUP)] == [group[name] for name in GROUP]).all(axis=1)]
            contenders = {one["label"]: tuple(one[name] for name in CONTENDER) for one in group["contenders"]}
            for metric in group["metrics"]:
                lines = mine[mine["metric"] == metric["name"]]
                assert [contenders[name] for name in metric["labels"]] == list(
                    lines[list(CONTENDER)].itertuples(index=False, name=None)
                )
                for name in ("mean", "ci_low", "ci_high", "rank_low", "rank_high", "solved", "planned"):
                    wanted = lines[name].to_numpy(dtype=float, na_value=math.nan)
                    got = np.array([math.nan if value is None else value for value in metric[name]])
                    assert np.allclose(got, wanted, rtol=1e-8, atol=0, equal_nan=True), (way, metric["name"], name)


def test_the_texts_are_those_that_the_leaderboard_prints(small, small_data):
    rows = small.rows(use_index=False)
    printed = render(leaderboard(rows, by="task"), "markdown", rows=rows)
    printed = printed.replace("*", "").replace("\\", "")
    (group,) = [group for group in small_data["groups"] if group["by"] == "task"]
    for metric in group["metrics"]:
        assert metric["heading"] in printed
        assert all(f"| {text} |" in printed for text in metric["texts"])
    assert [note for note in group["notes"] if note not in printed] == []
    assert [note for note in group["metrics"][0]["notes"] if note not in printed] == []


def test_a_variant_of_any_text_keeps_its_numbers():
    scores = [0.1, 0.2, 0.3, 0.4]
    odd = [row("a", f"s{i}", scores={"d": s}, variant="path=x\ny,name=<b>\x1b[1m") for i, s in enumerate(scores)]
    plain = [row("b", f"s{i}", scores={"d": 2 * s}) for i, s in enumerate(scores)]
    data = page_data(rows_of(*odd, *plain))
    for group in data["groups"]:
        (metric,) = group["metrics"]
        assert len(metric["labels"]) == 2 and "-" not in metric["texts"]
        assert not any("\n" in label or "\x1b" in label for label in metric["labels"])


def test_results_without_a_solved_case_have_a_page(visit, tmp_path):
    data = page_data(rows_of(*(row(name, f"s{i}") for name in "ab" for i in range(4))))
    assert [metric["name"] for group in data["groups"] for metric in group["metrics"]] == [""]
    path = tmp_path / "page.html"
    path.write_text(one_file(data), encoding="utf-8")
    page = visit(path)
    assert page.locator("main tbody tr").count() == 2
    for tab in page.locator("[role=tab]").all():
        tab.click()
        assert page.locator("main h2").count() >= 1


def test_every_row_is_a_case_and_every_failure_has_its_command(small, small_data):
    rows = small.rows(use_index=False)
    cases = small_data["cases"]
    assert cases["count"] == len(rows) == small_data["about"]["rows"]
    stored = cases["columns"]["score.surface_distance_mean"]
    assert np.allclose(
        [math.nan if x is None else x for x in stored], rows["score.surface_distance_mean"], equal_nan=True
    )
    lost = rows[rows["status"] != "ok"]
    assert sum(one["count"] for one in small_data["failures"]) == len(lost) == 4
    for one in small_data["failures"]:
        assert one["cell"] in set(lost["cell"]) and one["message"] == HOSTILE
        assert one["traceback"].startswith("Traceback")
        folder = small.folder.as_posix()
        assert one["command"] == f"detailbench reproduce {one['cell']} results={folder} --plugin 'my plugin.py'"


def test_a_command_names_its_folder_and_quotes_it():
    cells = {"abc": {"folder": "my results", "plugins": ["a.py", "b;c.py"]}}
    wanted = "detailbench reproduce abc 'results=my results' --plugin a.py --plugin 'b;c.py'"
    assert command_of("abc", cells) == wanted
    assert command_of("", cells) == ""


def test_traces_are_those_of_the_rows(small_data):
    method = small_data["cases"]["columns"]["method"]
    names = [method["values"][code] for code in method["codes"]]
    traces = small_data["traces"]
    assert [names[trace["row"]] for trace in traces] == ["rimls"] * 16
    for trace in traces:
        scores = trace["scores"]["chamfer_l1_mean"]
        assert scores[-1] == pytest.approx(small_data["cases"]["columns"]["score.chamfer_l1_mean"][trace["row"]])
        assert trace["seconds"] == sorted(trace["seconds"])


def test_provenance_counts_every_cell(small_data):
    told = small_data["provenance"]
    (machine,) = told["machines"]
    assert (machine["host"], machine["cells"], machine["first"][:10]) == ("node1", 20, "2026-01-01")
    assert told["packages"] == [{"name": "numpy", "version": "2.4.6", "cells": 20}]


def test_duels_are_of_tables_with_four_shapes_or_more(small_data):
    for group in small_data["groups"]:
        for metric in group["metrics"]:
            assert ("duels" in metric) == (max(metric["shapes"]) >= 4 and len(metric["labels"]) > 1)
    duels = small_data["groups"][0]["metrics"][0]["duels"]
    assert len(duels["ranks"]) == len(METHODS) and sum(duels["ranks"]) == pytest.approx(15)


def test_the_page_is_the_same_every_time(small, small_data):
    again = page_data(small.rows(use_index=False), [small], title=small_data["title"])
    assert one_file(again) == one_file(small_data)


@pytest.mark.parametrize(
    "ours,low,high,theirs,better,solved,status",
    [
        (1.0, 0.9, 1.1, 1.05, "lower", 8, "reproduces"),
        (0.5, 0.4, 0.6, 1.0, "lower", 8, "reproduces"),  # better than the paper's
        (0.5, 0.4, 0.6, 1.0, "higher", 8, "works"),
        (0.4, 0.3, 0.49, 1.0, "higher", 8, "differs"),
        (3.0, 0.9, 5.1, 1.0, "lower", 8, "reproduces"),  # the interval holds it
        (3.0, 2.9, 3.1, 1.0, "lower", 8, "differs"),
        (1.0, 0.9, 1.1, 1.0, "lower", 7, "differs"),
        (math.nan, math.nan, math.nan, 1.0, "lower", 0, "differs"),
        (1.15, math.nan, math.nan, 1.0, "lower", 8, "works"),
    ],
)
def test_the_status_of_a_number(ours, low, high, theirs, better, solved, status):
    assert status_of(ours, low, high, theirs, better, solved, 8) == status
