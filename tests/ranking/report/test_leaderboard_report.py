"""The printed forms: what they say, that nothing is cut off, that other programs can read them."""

import io
import json
import re

import numpy as np
import pandas as pd
import pytest
from boards import DOCUMENTED, row, rows

from bench.errors import UsageError
from bench.ranking.leaderboard import leaderboard
from bench.ranking.report import FORMATS, render
from bench.ranking.report.latex import escape
from bench.ranking.report.numbers import count, decimals, unit_exponent, with_interval
from bench.ranking.report.tables import tables

METRICS = [f"a_metric_with_a_long_name_{i}" for i in range(10)]


@pytest.fixture(scope="module")
def frame():
    """Three methods, ten metrics, failures, a learned method, names that need care."""
    rng = np.random.default_rng(0)
    records = []
    for k, method in enumerate(["best", "other_one", "fails|x"]):
        for case in "abcd":
            scores = {m: 1e-3 * (1 + k) * (1 + 0.02 * rng.random()) for m in METRICS}
            changes = {"dataset": "bumps[max_degree=20]", "variant": "depth=9,trim=0.1" if k == 1 else ""}
            failed = method == "fails|x" and case in "ab"
            record = row(method, case, 0, None if failed else scores, {} if failed else {METRICS[0]: 1e-4}, **changes)
            records.append(record | {"parameters": 1_300_000 if k == 1 else 0})
    records[-3]["message"] = "a message " + "x" * 300
    return rows(*records)


@pytest.fixture(scope="module")
def board(frame):
    return leaderboard(frame)


def test_csv_is_the_board(board):
    text = render(board, "csv")
    assert text.splitlines()[0] == DOCUMENTED
    back = pd.read_csv(
        io.StringIO(text), keep_default_na=False, na_values=[""], dtype={"variant": str, "front": "Int64"}
    )
    words = ["variant", "versus_next", "versus_first", "place"]
    back[words] = back[words].fillna("")
    pd.testing.assert_frame_equal(back, board, check_dtype=False, check_exact=True)


@pytest.mark.parametrize("format", FORMATS)
def test_every_method_and_every_metric_is_in_every_format(format, board, frame):
    text = render(board, format, rows=frame)
    plain = text.replace("\\", "")
    metrics = [f"{m[-1]} $downarrow$" for m in METRICS] if format == "latex" else METRICS  # titles have several lines
    assert all(name in plain for name in ["best", "other_one", "fails|x" if format != "latex" else "fails", *metrics])
    assert "\x1b" not in text


def test_the_terminal_keeps_its_width_and_loses_nothing(board, frame):
    text = render(board, "terminal", rows=frame, width=120)
    tables_only = text.split("Not solved")[0]
    assert max(map(len, tables_only.splitlines())) <= 120
    assert "…" not in tables_only
    assert text.count("1.0") >= len(METRICS)
    narrow = render(board, "terminal", rows=frame, width=20)
    assert sorted(re.findall(r"\[.*?\]", narrow)) == sorted(re.findall(r"\[.*?\]", text))


def test_the_terminal_lists_the_failures(board, frame):
    text = render(board, "terminal", rows=frame)
    for message in ("a: boom", "b: a message"):  # each kind of message has its case
        assert f"fails|x: 1 error (reconstruct · bumps[max_degree=20] · samples): {message}" in text
    assert "2/4" in text and "†" in text and "†† the mean leaves failed cases out" in text
    assert "1.3M" in text


def test_active_parameters_stand_beside_all(board, frame):
    """Where a method has a sparse layout, the table gives both numbers; older results have neither."""
    assert "active" not in render(board, "markdown", rows=frame)
    told = frame.assign(active_parameters=[420_036 if m == "other_one" else None for m in frame["method"]])
    assert "1.3M (420k active)" in render(board, "markdown", rows=told)
    assert "- |" in render(board, "markdown", rows=told)


def test_best_is_marked(board, frame):
    lines = render(board, "terminal", rows=frame).splitlines()
    assert "*" in next(line for line in lines if line.startswith("best"))
    assert "*" not in next(line for line in lines if line.startswith("other_one"))
    assert "\x1b[1m" in render(board, "terminal", rows=frame, color=True)


def test_markdown_tables_are_rectangular(board, frame):
    text = render(board, "markdown", rows=frame)
    lines = [line for line in text.splitlines() if line.startswith("|")]
    cells = [len(re.split(r"(?<!\\)\|", line)) for line in lines]
    assert len(lines) == 2 + 3 + 1
    assert len(set(cells)) == 1
    assert r"fails\|x" in text
    assert set(lines[1]) <= set("|-: ")


def test_latex_is_balanced_and_escaped(board, frame):
    text = render(board, "latex", rows=frame)
    for name in ("table", "tabular"):
        assert text.count(rf"\begin{{{name}}}") == text.count(rf"\end{{{name}}}") > 0
    body = re.sub(r"\\[#$%&_{}]", "", "\n".join(line for line in text.splitlines() if not line.startswith("%")))
    assert body.count("{") == body.count("}")
    assert body.count("$") % 2 == 0
    assert "_" not in body and "%" not in body
    assert body.isascii()
    for tabular in re.findall(r"\\begin\{tabular\}\{(\w+)\}(.*?)\\end\{tabular\}", body, re.DOTALL):
        columns, inside = tabular
        for line in (part for part in inside.splitlines() if part.endswith(r"\\")):
            assert line.count("&") == len(columns) - 1


def test_latex_escapes_every_special_letter():
    assert escape("a_b") == r"a\_b"
    assert escape(r"50% {x} #1 & ~ ^ \ $") == (
        r"50\% \{x\} \#1 \& \textasciitilde{} \textasciicircum{} \textbackslash{} \$"
    )


def test_an_unknown_format_gets_the_nearest(board):
    with pytest.raises(UsageError, match="Did you mean 'markdown'"):
        render(board, "markdwn")


@pytest.mark.parametrize("format", FORMATS)
def test_empty_boards_print(format, frame):
    assert render(leaderboard(frame.iloc[:0]), format, rows=frame.iloc[:0])


def test_groups_where_all_failed_print():
    frame = rows(row("a", "x"), row("a", "y"))
    text = render(leaderboard(frame), "terminal", rows=frame)
    assert "0/2" in text and "2 error" in text
    assert "0/2" in render(leaderboard(frame), "markdown") and "0/2" in render(leaderboard(frame), "latex")


def test_a_task_without_a_sensor_says_how_large_its_details_are_and_another_how_its_clouds_are():
    details = {"input.detail_rms": 0.021, "input.detail_max": 0.035, "input.detail_thickness": 0.035}
    cloud = {"input.points": 100.0, "input.rms": 0.01, "input.rms_inliers": 0.01, "input.outliers": 0.0}
    cloud |= {"input.coverage": 1.0, "input.density_variation": 0.3}
    frame = rows(
        row("a", "x", 0, {"d": 1.0}, task="detail_transfer", sensor="", **details),
        row("a", "x", 0, {"d": 1.0}, **cloud),
        row("a", "x", 0, {"d": 1.0}, task="silent"),
    )
    found = {table.title: table.notes[0] for table in tables(leaderboard(frame), frame)}
    assert list(found) == ["detail_transfer · bumps", "reconstruct · bumps · samples", "silent · bumps · samples"]
    transfer, clouds, silent = found.values()
    assert transfer.startswith("details to transfer") and "0.021 root mean square, at most 0.035" in transfer
    assert clouds.startswith("input, median of the cases: 100 points")
    assert silent.startswith("rank:")


def test_the_metrics_stand_in_the_order_asked_for(board):
    table = tables(board, metrics=[METRICS[4]])[0]
    assert [m.name for m in table.metrics][:2] == [METRICS[4], METRICS[0]]


def test_what_describes_a_result_stands_behind_what_measures_it():
    directions = {"components": "reference", "dist": "lower", "a_count": "lower", "fscore": "higher"}
    scores = dict.fromkeys(directions, 1.0)
    floors = {"dist": 0.1, "components": 1.0}
    frame = rows(*(row("m", c, 0, scores, floors, directions=json.dumps(directions)) for c in "ab"))
    assert [m.name for m in tables(leaderboard(frame))[0].metrics] == ["dist", "a_count", "fscore", "components"]


@pytest.mark.parametrize(
    ("value", "low", "high", "text"),
    [
        (0.5, 0.4, 0.6, "0.50 [0.40, 0.60]"),
        (12.345, 11.0, 14.0, "12.3 [11.0, 14.0]"),
        (123.4, -50.0, 300.0, "123 [-50, 300]"),
        (0.98765, 0.987649, 0.987651, "0.98765 [0.98765, 0.98765]"),
        (1.0, 1.0, 1.0, "1 [1, 1]"),
        (0.123456, np.nan, np.nan, "0.123"),
        (np.nan, np.nan, np.nan, "-"),
        (-0.001, -1.0, 1.0, "0.0 [-1.0, 1.0]"),
        (0.5, 0.43, 0.57, "0.500 [0.430, 0.570]"),
        (0.0, -1e-6, 1e-6, "0.0000 [0.0000, 0.0000]"),
        (1234.6, np.nan, np.nan, "1235"),
        (0.00012, np.nan, np.nan, "0.0001"),
    ],
)
def test_digits(value, low, high, text):
    assert with_interval(value, low, high) == text


def test_units_of_columns():
    assert unit_exponent([2e-5, 3e-5, 0.4]) == -6
    assert unit_exponent([7.2e-4, 1.8e-3, 6e-4]) == -3
    assert unit_exponent([0.5, 0.0, np.nan]) == 0
    assert unit_exponent([]) == 0
    assert unit_exponent([5e6]) == 6
    assert (unit_exponent([99_999.0]), unit_exponent([1e5])) == (0, 6)
    assert (unit_exponent([2e-5, 0.3]), unit_exponent([2e-5, 0.3, 0.4])) == (-6, 0)  # of two the smaller one
    assert decimals(2.0, np.nan, np.nan) == 0
    assert [count(n) for n in (12, 1300, 1_250_000, 1.5e9, np.nan)] == ["12", "1.3k", "1.25M", "1.5G", "-"]


def test_a_score_that_only_one_of_several_methods_has_marks_no_winner():
    two = [row("oriented", case, 0, {"d": 1.0, "angle": 3.0}) for case in "abcdef"]
    two += [row("bare", case, 0, {"d": 2.0}) for case in "abcdef"]
    frame = rows(*two)
    text = render(leaderboard(frame), "markdown", rows=frame)
    line = next(line for line in text.splitlines() if line.startswith("| oriented"))
    assert "**1" in line and "**3" not in line and "3" in line
