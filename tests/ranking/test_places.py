"""Which means stand out, and how the numbers of a column are printed."""

import math

import numpy as np
import pytest
from boards import table, units

from bench.ranking.leaderboard import leaderboard
from bench.ranking.places import places
from bench.ranking.report.numbers import column_digits, parts_with_interval


def marks(means, first, whole=None):
    column = np.array(means, dtype=float)[:, None]
    whole = [True] * len(means) if whole is None else whole
    return places(column, np.array(first)[:, None], np.array(whole)[:, None])[:, 0].tolist()


def test_the_best_mean_the_ties_and_the_second():
    assert marks([3.0, 1.0, 2.0, 9.0], [True, True, False, False]) == ["tied", "best", "second", ""]
    assert marks([2.0, 1.0, 3.0], [True, True, True]) == ["tied second", "best", "tied"]
    assert marks([2.0, 1.0], [True, True]) == ["tied", "best"]  # of two there is no second best


def test_equal_means_are_both_the_best_and_leave_no_second():
    assert marks([1.0, 1.0 + 1e-12, 2.0], [True] * 3) == ["best", "best", "tied"]
    assert marks([0.0, 0.0, 0.0], [True] * 3) == ["best"] * 3
    assert marks([1e-6, 1.1e-6, 2e-6], [True] * 3) == ["best", "tied second", "tied"]  # relative to their size
    assert marks([1e6, 1e6 + 1e-5, 2e6], [True] * 3) == ["best", "best", "tied"]


@pytest.mark.parametrize("shapes", [1, 2, 3, 4, 6])
def test_too_few_shapes_have_no_best_method_unless_it_is_the_only_one(shapes):
    good, bad = ({case: size + 0.1 * i for i, case in enumerate("abcdef"[:shapes])} for size in (1.0, 3.0))
    scores = {name: units(*found.values(), cases=list(found)) for name, found in (("good", good), ("bad", bad))}
    assert leaderboard(table(scores))["place"].tolist() == (["best", ""] if shapes >= 4 else ["", ""])
    assert leaderboard(table({"bad": scores["bad"]}))["place"].tolist() == ["best"]


def test_what_failed_is_neither_best_nor_second():
    assert marks([1.0, 2.0, 3.0, 4.0], [True] * 4, [False, True, True, False]) == ["tied", "best", "tied", "tied"]
    assert marks([1.0, 2.0, 3.0, 4.0], [True] * 4, [False, True, True, True])[2] == "tied second"
    assert marks([1.0, math.nan], [True, False]) == ["best", ""]


def test_a_better_mean_on_other_cases_is_not_the_best_if_others_are_surely_better():
    assert marks([1.0, 2.0, 3.0], [False, True, True]) == ["second", "best", "tied"]


def test_nothing_is_highlighted_without_ranks():
    assert marks([1.0, 2.0, 3.0], [False] * 3, [False] * 3) == ["", "", ""]


@pytest.mark.parametrize(
    ("intervals", "digits"),
    [
        ([(3.9, 2.8, 9.9), (4.3, 2.8, 8.0), (13.0, 5.0, 58.0)], 1),
        ([(0.02, 0.01, 0.03), (120.0, 50.0, 300.0), (140.0, 50.0, 300.0)], 3),  # two digits of the smallest
        ([(0.0, 0.0, 0.0), (543.0, 60.0, 1026.0)], 0),
        ([(math.nan, math.nan, math.nan)], 0),
        ([(2.59, math.nan, math.nan), (0.894, math.nan, math.nan)], 2),
        ([(10.0, 9.5, 10.5), (20.0, 15.0, 25.0), (30.0, -20.0, 80.0)], 1),  # 2, 1 and 0 are supported
        ([(3.0, math.nan, math.nan), (12.0, math.nan, math.nan)], 0),  # numbers of something
        ([(3.4, -30.0, 40.0)], 1),  # two digits, whatever the interval
        ([(0.5, math.nan, math.nan), (1e-7, math.nan, math.nan)], 4),  # the most
        ([(0.95, math.nan, math.nan)], 3),
    ],
)
def test_a_column_has_one_number_of_decimals(intervals, digits):
    assert column_digits(intervals) == digits
    assert column_digits([tuple(1e-3 * x for x in one) for one in intervals], -3) == digits


@pytest.mark.parametrize(
    ("style", "found"),
    [
        ("inside", ("3.20 [2.10, 4.30]", "")),
        ("below", ("3.20", "[2.10, 4.30]")),
        ("plusminus", ("3.20 ± 1.10", "")),
        ("none", ("3.20", "")),
    ],
)
def test_intervals_as_they_are_wanted(style, found):
    assert parts_with_interval(3.2e-3, 2.1e-3, 4.3e-3, -3, 2, style) == found
    assert parts_with_interval(math.nan, math.nan, math.nan, 0, 2, style) == ("-", "")
    assert parts_with_interval(3.2, math.nan, math.nan, 0, 1, style) == ("3.2", "")
