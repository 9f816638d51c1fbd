"""What each unit of a table counts: several results of it or none, scores that are not known, and bounds of scores."""

import itertools

import numpy as np
import pandas as pd
import pytest
from boards import row, rows, table, units

from bench.ranking.leaderboard import FAR, leaderboard, unit_scores, unit_values
from bench.ranking.selection import CONTENDER, GROUP, UNIT, pool

STUDENT = 12.706204736  # the quantile of Student's t at 97.5 % with one degree of freedom: of two shapes


def test_one_unit_by_hand():
    board = leaderboard(rows(row("a", "x", 0, {"n": 7.0}, {"n": 4.0}, better="reference")))
    got = board.iloc[0]
    assert (got["mean"], got["floor"], got["score_mean"], got["place"]) == (3, 4, 7, "best")
    assert (got["shapes"], got["not_run"], got["undefined"]) == (1, 0, 0)


def test_several_results_of_a_unit_are_averaged_before_units_are():
    frame = rows(
        row("a", "x", 0, {"n": 5.0}, {"n": 1.0}, better="reference", finished="1"),
        row("a", "x", 0, {"n": -1.0}, {"n": 2.0}, better="reference", finished="2"),
        row("a", "y", 0, {"n": 9.0}, {"n": 3.0}, better="reference", finished="3"),
    )
    got = leaderboard(frame).iloc[0]
    assert got["mean"] == ((4 + 3) / 2 + 6) / 2  # distances: 5 too high and 5 too low are not perfect
    assert got["score_mean"] == (2 + 9) / 2
    assert got["floor"] == (1.5 + 3) / 2
    assert (got["solved"], got["planned"]) == (3, 3)
    units = unit_values(pool(frame), "n")
    assert units[["value", "badness", "planned", "solved"]].to_numpy().tolist() == [[3.5, 3.5, 2, 2], [6, 6, 1, 1]]


def test_not_even_the_last_digit_depends_on_the_order_of_several_results():
    records = [row("a", "x", 0, {"d": d}, finished=f"{d}") for d in (0.1, 0.2, 0.3)]
    means = {leaderboard(rows(*order)).loc[0, "mean"] for order in itertools.permutations(records)}
    assert len(means) == 1
    bare = rows(*records).drop(columns="finished")  # as other tools may write them
    got = leaderboard(bare).loc[0]
    assert got["mean"] == pytest.approx(0.2) and pd.isna(got["floor"])


@pytest.fixture
def three():
    """A method that is known on every unit that it was run on, and one whose failure nobody can tell the score of."""
    return rows(
        row("a", "x", 0, {"f": 0.2}, better="higher"),
        row("a", "y", 0, worst={"f": 0.1}),
        row("b", "x", 0, {"f": 0.4}, better="higher"),
        row("b", "y", 0, {"f": 0.5}, better="higher"),
        row("b", "z", 0),
        row("c", "x", 0, {"e": 1.0}),
    )


def test_the_scores_of_units_as_tests_see_them(three):
    found = unit_scores(pool(three), "f")
    assert found.units.equals(pd.DataFrame({"case": list("xyz"), "seed": 0, "condition": ""})[UNIT])
    assert found.contenders.equals(three.drop_duplicates("method")[CONTENDER].reset_index(drop=True))
    planned = np.array([[1, 1, 0], [1, 1, 0], [0, 1, 0]], dtype=bool)
    assert found.planned.tolist() == planned.tolist()
    wanted = np.array([[-0.2, -0.4, 0], [-0.1, -0.5, 0], [0, FAR * 0.5, 0]])  # the unknown one: worse than any answer
    assert found.values[planned] == pytest.approx(wanted[planned])


def test_the_scores_of_units_as_readers_see_them(three):
    found = unit_values(pool(three), "f")
    wanted = [
        ["x", "a", 0.2, -0.2, 1, 1, 0],
        ["x", "b", 0.4, -0.4, 1, 1, 0],
        ["y", "a", 0.1, -0.1, 1, 0, 1],
        ["y", "b", 0.5, -0.5, 1, 1, 0],
        ["z", "b", np.nan, np.nan, 1, 0, 0],
    ]
    columns = ["case", "method", "value", "badness", "planned", "solved", "imputed"]
    assert set(found.columns) == {*GROUP, *UNIT, *CONTENDER, *columns, "better"}
    pd.testing.assert_frame_equal(found[columns], pd.DataFrame(wanted, columns=columns), check_dtype=False)
    assert set(found["better"]) == {"higher"}


def test_a_result_that_is_lacking_beside_another_of_its_unit_is_left_out():
    frame = rows(row("a", "x", 0, {"d": 3.0}), row("a", "x", 0))
    assert unit_values(pool(frame), "d")[["value", "badness"]].to_numpy().tolist() == [[3, 3]]
    assert unit_scores(pool(frame), "d").values.tolist() == [[FAR]]  # it failed, and by how much nobody knows


def test_a_mean_score_is_over_what_is_known():
    frame = rows(row("a", "x", 0, {"n": 3.0}, {"n": 1.0}, better="reference"), row("a", "y", 0))
    assert leaderboard(frame).loc[0, ["mean", "score_mean"]].tolist() == [2, 3]


def test_units_that_were_not_run_and_units_without_a_score_are_counted():
    frame = rows(
        row("a", "x", 0, {"d": 1.0}),
        row("a", "y", 0, {"d": 1.0, "e": 1.0}),
        row("b", "x", 0, {"d": 1.0, "e": 1.0}),
        row("b", "y", 0, {"d": 1.0, "e": 1.0}),
        row("b", "z", 0, {"d": 1.0}),  # no output has the other score here
    )
    board = leaderboard(frame).set_index(["metric", "method"])
    assert board["not_run"].to_dict() == {("d", "a"): 1, ("d", "b"): 0, ("e", "a"): 1, ("e", "b"): 0}
    assert board["shapes"].to_dict() == {("d", "a"): 2, ("d", "b"): 3, ("e", "a"): 1, ("e", "b"): 2}
    assert board["undefined"].to_dict() == {("d", "a"): 0, ("d", "b"): 0, ("e", "a"): 1, ("e", "b"): 0}


@pytest.mark.parametrize(
    ("better", "scores", "bounds"),
    [
        ("lower", (0.1, 0.3), (0, None)),  # a distance: never negative
        ("lower", (0.0, 0.3), (0, None)),
        ("lower", (-0.1, 0.3), (None, None)),
        ("lower", (0.4, 1.0), (0, None)),
        ("lower", (0.0, 1.0), (0, 1)),  # yes or no
        ("higher", (0.4, 1.0), (0, 1)),  # a share
        ("higher", (0.4, 1.2), (0, None)),
        ("higher", (-0.1, 0.5), (None, None)),
    ],
)
def test_intervals_end_where_scores_do(better, scores, bounds):
    """Two shapes have Student's interval, however many seeds each has."""
    a, b = scores
    got = leaderboard(table({"a": units(a, a, b, b, cases="xy", seeds=2)}, better=better)).iloc[0]
    ends = ((a + b) / 2 + sign * STUDENT * abs(a - b) / 2 for sign in (-1, 1))
    wanted = [end if bound is None else bound for end, bound in zip(ends, bounds, strict=True)]
    assert got[["ci_low", "ci_high"]].tolist() == pytest.approx(wanted)
