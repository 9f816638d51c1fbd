"""Failing never pays: a failed case counts as the worst pseudo-method does on it, whoever else is in the table."""

import numpy as np
import pandas as pd
import pytest
from boards import line, ranks, row, rows, units

from bench.ranking.leaderboard import leaderboard, penalise
from bench.ranking.overview import overview
from bench.ranking.report import FORMATS, render
from bench.ranking.report.tables import tables
from bench.results.imputation import worst_scores

CASES = "abcdefghijklmnop"
TIMES = 30.0  # what no method at all is worse by


def world(rng, cases=16):
    """How hard each case is, and what random points score on it."""
    hard = 0.01 * np.exp(0.5 * rng.normal(size=cases))
    return hard, TIMES * hard


def frame(hard, worst, **methods):
    """Rows of methods, given by their scores in units of how hard each case is; NaN is a failure."""
    records = []
    for method, factors in methods.items():
        for case, size, limit, factor in zip(CASES, hard, worst, factors, strict=False):
            scores = None if np.isnan(factor) else {"d": factor * size}
            records.append(row(method, case, 0, scores, worst=None if limit is None else {"d": limit}))
    return rows(*records)


def luck(rng, factor=1.0, cases=16):
    return factor * np.exp(0.05 * rng.normal(size=cases))


def failing(factors, count, value=np.nan):
    """The same with the last ``count`` cases failed, or answered that badly."""
    return np.r_[factors[: len(factors) - count], np.full(count, value)]


# -- the examples that were measured -----------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [2, 4])
def test_failing_gives_the_same_place_as_answering_badly(count):
    """20 % better on all other cases: today that stood alone at rank 1, while the answers made it third."""
    rng = np.random.default_rng(count)
    hard, worst = world(rng)
    others = {name: luck(rng, 1 + 0.02 * i) for i, name in enumerate("bcd")}
    good = luck(rng, 0.8)
    boards = [leaderboard(frame(hard, worst, a=failing(good, count, value), **others)) for value in (np.nan, TIMES)]
    columns = ["method", "mean", "ci_low", "ci_high", "rank_low", "rank_high"]
    pd.testing.assert_frame_equal(boards[0][columns], boards[1][columns])
    assert boards[0]["method"].tolist().index("a") > 0 and ranks(boards[0])["a"][1] > 1
    assert line(boards[0], "a")["mean"] > line(boards[0], "b")["mean"]
    assert (line(boards[0], "a")["solved"], line(boards[0], "a")["imputed"]) == (16 - count, count)
    (table,) = tables(boards[0])
    cell = table.metrics[0].cells[table.methods.index("a")]
    assert cell.mark == "†" and not cell.best
    assert any(note.startswith("† failed cases enter mean and rank with") for note in table.notes)


def test_failing_half_of_the_cases_is_no_tie_for_the_first_place():
    """Two methods, one 10 % better on eight cases and failing on eight: its mean was less than half, and bold."""
    rng = np.random.default_rng(0)
    hard, worst = world(rng)
    board = leaderboard(frame(hard, worst, a=failing(luck(rng, 0.9), 8), b=luck(rng)))
    assert board["method"].tolist() == ["b", "a"]
    assert ranks(board) == {"b": (1, 1), "a": (2, 2)}
    assert line(board, "a")["mean"] > 5 * line(board, "b")["mean"]


@pytest.mark.parametrize("known", [True, False])
def test_the_order_of_two_methods_does_not_depend_on_a_third(known):
    """10 % better on ten, failing on six: first with b alone, significantly second when noise was there too."""
    rng = np.random.default_rng(1)
    hard, worst = world(rng)
    worst = worst if known else [None] * len(worst)
    two = {"a": failing(luck(rng, 0.9), 6), "b": luck(rng)}
    others = {"noise": luck(rng, TIMES), "far": luck(rng, 1000.0), "near": luck(rng, 0.1), "lost": np.full(16, np.nan)}
    alone = leaderboard(frame(hard, worst, **two))
    assert alone["method"].tolist() == ["b", "a"]
    for name, factors in others.items():
        board = leaderboard(frame(hard, worst, **two, **{name: factors}))
        kept = [method for method in board["method"] if method in two]
        assert kept == ["b", "a"], name
        assert line(board, "a")["mean"] == line(alone, "a")["mean"]
    everybody = leaderboard(frame(hard, worst, **two, **others))
    assert [method for method in everybody["method"] if method in two] == ["b", "a"]


def test_failing_on_the_hardest_cases_does_not_make_the_best_mean():
    """The worst of four fails on the four hardest of eight: its mean became the best of the table."""
    rng = np.random.default_rng(2)
    hard, worst = world(rng, 8)
    hard = np.sort(hard)
    scores = {name: luck(rng, factor, 8) for name, factor in (("a", 1.0), ("b", 1.05), ("c", 1.1))}
    board = leaderboard(frame(hard, TIMES * hard, **scores, bad=failing(luck(rng, 1.5, 8), 4)))
    assert board["method"].tolist()[-1] == "bad"
    assert line(board, "bad")["mean"] == board["mean"].max()


# -- the rule ----------------------------------------------------------------------------------------------------------


def test_by_hand():
    frame = rows(
        row("a", "x", 0, {"d": 1.0}, worst={"d": 10.0}),
        row("a", "y", 0, status="timeout", worst={"d": 20.0}),
        row("b", "x", 0, {"d": 2.0}, worst={"d": 10.0}),
        row("b", "y", 0, {"d": np.nan}, worst={"d": 20.0}),
        row("c", "x", 0, {"d": 3.0}, worst={"d": 10.0}),
        row("c", "y", 0, {"d": 5.0}, worst={"d": 20.0}),
    )
    board = leaderboard(frame)
    assert {m: line(board, m)["mean"] for m in "abc"} == {"a": 10.5, "b": 11.0, "c": 4.0}
    assert board["imputed"].tolist() == [0, 1, 1] and board["method"].tolist() == ["c", "a", "b"]


def test_higher_is_better_and_nearest_the_reference():
    share = rows(
        *(row("a", c, 0, {"f": 0.9}, better="higher", worst={"f": 0.0}) for c in "xyz"),
        row("a", "w", 0, worst={"f": 0.0}),
        *(row("b", c, 0, {"f": 0.8}, better="higher", worst={"f": 0.0}) for c in "wxyz"),
    )
    board = leaderboard(share)
    assert board["method"].tolist() == ["b", "a"] and line(board, "a", "f")["mean"] == pytest.approx(0.675)
    # The failed row has no floor, the reference's own value: that of the other method on the case says it.
    count = rows(
        *(row("a", c, 0, {"n": 1.0}, {"n": 1.0}, better="reference", worst={"n": 500.0}) for c in "xyz"),
        row("a", "w", 0, worst={"n": 500.0}),
        *(row("b", c, 0, {"n": 3.0}, {"n": 1.0}, better="reference", worst={"n": 500.0}) for c in "wxyz"),
    )
    board = leaderboard(count)
    assert board["method"].tolist() == ["b", "a"] and line(board, "a", "n")["mean"] == pytest.approx(499 / 4)
    assert line(board, "a", "n")["score_mean"] == pytest.approx(503 / 4)


def test_a_row_without_the_values_borrows_those_of_its_case_even_of_a_method_that_is_not_shown():
    """A dead process told nothing, and results of an earlier version lie beside new ones."""
    records = [row("a", c, s, {"d": 1.0}) for c in "xy" for s in (0, 1)]
    records[0] = row("a", "x", 0, status="crashed")
    records += [row("noise", c, s, {"d": 9.0}, worst={"d": 10.0 + s}) for c in "xy" for s in (0, 1)]
    board = leaderboard(rows(*records), method="a")
    assert line(board, "a")["mean"] == (10 + 1 + 1 + 1) / 4
    assert line(board, "a")["imputed"] == 1
    pooled = pd.concat([rows(*records), rows(*records).assign(sensor="noisy", **{"worst.d": np.nan})])
    assert line(leaderboard(pooled, by="task", method="a"), "a")["imputed"] == 1  # another sensor, another case


def test_results_of_earlier_versions_leave_failures_out_of_the_mean_and_report_it():
    rng = np.random.default_rng(3)
    hard, _ = world(rng, 8)
    old = frame(hard, [None] * 8, a=failing(luck(rng, 0.9, 8), 4), b=luck(rng, 1.0, 8))
    board = leaderboard(old)
    assert board["method"].tolist() == ["b", "a"] and board["imputed"].tolist() == [0, 0]
    assert line(board, "a")["mean"] == pytest.approx(old["score.d"][:4].mean())
    (table,) = tables(board)
    assert table.metrics[0].cells[1].mark == "††" and not table.metrics[0].cells[1].best
    assert any(note.startswith("†† the mean leaves failed cases out") for note in table.notes)


def test_what_is_not_known_is_worse_than_any_answer():
    badness = np.array([[[1.0], [-5.0], [0.0]], [[2.0], [0.0], [0.0]]])
    known = np.array([[[1], [1], [0]], [[1], [0], [0]]], dtype=bool)
    full = penalise(badness, known)[..., 0]
    assert full[known[..., 0]].tolist() == [1, -5, 2]
    assert (full[~known[..., 0]] == 5e6).all()
    assert (penalise(np.full((2, 2, 1), 0.25), known[:, :2])[~known[:, :2]] == 0.25e6).all()
    assert (penalise(np.zeros((2, 2, 1)), known[:, :2] & False) == 1e6).all()


def test_who_solved_nothing_has_no_mean_even_if_its_worth_is_known():
    board = leaderboard(frame(*world(np.random.default_rng(0)), a=np.ones(16), none=np.full(16, np.nan)))
    got = board.iloc[-1]
    assert (got["method"], got["solved"], got["planned"]) == ("none", 0, 16)
    assert np.isnan(got["mean"]) and np.isnan(got["ci_low"]) and pd.isna(got["rank_low"])
    assert ranks(board) == {"a": (1, 1), "none": None}
    assert tables(board)[0].ranks == ("1", "-")


@pytest.mark.parametrize("format", FORMATS)
def test_every_format_marks_it_and_prints_no_rank(format):
    rng = np.random.default_rng(4)
    made = frame(*world(rng), a=failing(luck(rng, 0.1), 1), b=luck(rng), none=np.full(16, np.nan))
    text = render(leaderboard(made), format, rows=made)
    lines = [entry for entry in text.splitlines() if "none" in entry]
    if format == "csv":
        head = text.splitlines()[0].split(",")
        got = dict(zip(head, lines[0].split(","), strict=True))
        assert got["rank_low"] == got["rank_high"] == got["mean"] == "" and got["imputed"] == "16"
    else:
        dash = " -- " if format == "latex" else " - "
        assert dash in lines[0]
        assert ("$^\\dagger$" if format == "latex" else "†") in text
        assert "worst pseudo-method" in text


def test_views_across_groups_impute_too():
    rng = np.random.default_rng(5)
    made = frame(*world(rng), a=failing(luck(rng, 0.9), 4), b=luck(rng)).assign(tags="thin")
    board = overview(made, "tag")
    assert board[board["method"] == "a"]["imputed"].tolist() == [4, 4]
    assert board["method"].tolist() == ["b", "a", "b", "a"]


# -- which value -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("direction", "noise", "empty", "perfect", "worst"),
    [
        ("lower", 0.4, np.inf, 0.01, 0.4),
        ("lower", 57.0, 90.0, 1.0, 90.0),
        ("higher", 0.02, 0.0, 0.99, 0.0),
        ("higher", -0.1, -1.0, 1.0, -1.0),
        ("reference", 500.0, 0.0, 1.0, 500.0),
        ("reference", 3.0, 0.0, 2.0, 0.0),
        ("lower", 0.37, np.inf, 0.52, None),  # noise is more even than a perfect sample
        ("higher", 1.0, 0.0, 0.96, 0.0),
        ("reference", 0.0, np.nan, 0.0, None),
    ],
)
def test_the_worst_is_finite_and_worse_than_a_perfect_output(direction, noise, empty, perfect, worst):
    got = worst_scores([{"k": noise}, {"k": empty}], {"k": perfect}, lambda key: direction)
    assert got == ({} if worst is None else {"k": worst})


def test_a_metric_that_refuses_one_of_the_outputs_is_judged_by_the_other():
    assert worst_scores([{"k": 3.0}], {"k": 1.0}, lambda key: "lower") == {"k": 3.0}
    assert worst_scores([{"k": 3.0}], {}, lambda key: "lower") == {}


def test_units_of_several_seeds_are_imputed_one_by_one():
    made = {(c, s): None if (c, s) == ("a", 1) else 1.0 for c, s in units(*range(8), cases="abcd", seeds=2)}
    records = [row("m", c, s, None if v is None else {"d": v}, worst={"d": 9.0}) for (c, s), v in made.items()]
    assert line(leaderboard(rows(*records)), "m")["mean"] == 2.0
