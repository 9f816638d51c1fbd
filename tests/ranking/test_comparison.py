"""Win rates and average ranks against naive loops and scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from bench.ranking.comparison import average_ranks, critical_difference, ranks_within, win_rates

STARTS = np.array([0, 3, 5, 6, 10])  # five shapes, of one to four units


def scores(seed=0, units=13, k=4):
    generator = np.random.default_rng(seed)
    values = np.round(generator.lognormal(size=(units, k)), 1)  # with ties
    return values, generator.random((units, k)) > 0.15


def test_win_rates_are_what_loops_count():
    values, planned = scores()
    rate, low, high, clusters = win_rates(values, planned, STARTS)
    for i in range(4):
        for j in range(4):
            common = [u for u in range(13) if planned[u, i] and planned[u, j]]
            won = [1.0 if values[u, i] < values[u, j] else 0.5 if values[u, i] == values[u, j] else 0.0 for u in common]
            assert rate[i, j] == pytest.approx(np.mean(won))
            assert clusters[i, j] == len({int(np.searchsorted(STARTS, u, side="right")) for u in common})
    assert np.allclose(rate + rate.T, 1)
    off = ~np.eye(4, dtype=bool)
    assert (low <= rate)[off].all() and (rate <= high)[off].all()
    assert (low >= 0).all() and (high <= 1).all()


def test_a_win_on_every_shape_is_not_taken_for_certain():
    """With n shapes and no loss the interval is that of a binomial share, as scipy has it."""
    values = np.column_stack([np.zeros(8), np.ones(8)])
    rate, low, high, _ = win_rates(values, np.ones((8, 2), bool), np.arange(8))
    wanted = stats.binomtest(8, 8).proportion_ci(0.95, method="exact")
    assert (rate[0, 1], rate[1, 0]) == (1, 0)
    assert low[0, 1] == pytest.approx(wanted.low) and high[0, 1] == 1
    assert high[1, 0] == pytest.approx(1 - wanted.low) and low[1, 0] == 0


@pytest.mark.parametrize("common", [1, 2])
def test_a_pair_without_two_common_shapes_has_no_interval(common):
    planned = np.ones((4, 2), bool)
    planned[common:, 0] = False
    rate, low, high, clusters = win_rates(np.arange(8.0).reshape(4, 2), planned, np.arange(4))
    assert rate[0, 1] == 1 and clusters[0, 1] == common
    if common == 1:
        assert np.isnan(low[0, 1]) and np.isnan(high[0, 1])
    else:
        assert low[0, 1] == pytest.approx(0.025**0.5) and high[0, 1] == 1


@pytest.mark.parametrize(
    ("values", "tie"),
    [((0.0, 0.0), True), ((1.0, 1.0 + 1e-12), True), ((-1e-6, -1e-6), True), ((1e-6, 1.1e-6), False)],
)
def test_only_what_is_equal_up_to_rounding_is_a_tie(values, tie):
    """Perfect scores are equal, and small ones differ by their own size; the order of the methods does not matter."""
    rate = win_rates(np.array([values]), np.ones((1, 2), bool), np.array([0]))[0]
    assert (rate[0, 1], rate[1, 0]) == ((0.5, 0.5) if tie else (1, 0))
    for turned in (values, values[::-1]):
        ranks = dict(zip(turned, ranks_within(np.array([turned]))[0], strict=True))
        assert [ranks[value] for value in values] == ([1.5, 1.5] if tie else [1, 2])


def test_the_intervals_of_two_equal_methods_hold_a_half():
    generator = np.random.default_rng(1)
    held = 0
    for _ in range(200):
        values = generator.lognormal(size=(20, 2))
        _, low, high, _ = win_rates(values, np.ones((20, 2), bool), np.arange(20))
        held += low[0, 1] <= 0.5 <= high[0, 1]
    assert held >= 180  # 95 % of 200, less four standard errors


def test_ranks_within_rows_are_those_of_scipy():
    values, _ = scores()
    assert np.array_equal(ranks_within(values), stats.rankdata(values, axis=1))


def test_friedmans_test_is_that_of_scipy():
    values, _ = scores(units=9, k=5)
    found = average_ranks(values, np.ones_like(values, bool), np.arange(9))
    statistic, p = stats.friedmanchisquare(*values.T)
    assert (found.blocks, found.statistic, found.p) == (9, pytest.approx(statistic), pytest.approx(p))
    assert np.allclose(found.ranks, stats.rankdata(values, axis=1).mean(axis=0))


def test_units_of_a_shape_are_one_block():
    values, _ = scores()
    found = average_ranks(values, np.ones_like(values, bool), STARTS)
    ends = [*STARTS[1:], len(values)]
    means = [stats.rankdata(values[a:b], axis=1).mean(axis=0) for a, b in zip(STARTS, ends, strict=True)]
    assert found.blocks == 5
    assert np.allclose(found.ranks, stats.rankdata(means, axis=1).mean(axis=0))


def test_units_that_a_method_was_not_to_solve_are_left_out():
    values, _ = scores(units=8, k=3)
    planned = np.ones_like(values, bool)
    planned[2, 1] = False
    kept = np.delete(np.arange(8), 2)
    found = average_ranks(values, planned, np.arange(8))
    assert found.blocks == 7
    assert np.allclose(found.ranks, stats.rankdata(values[kept], axis=1).mean(axis=0))


def test_the_critical_difference_is_that_of_the_paper():
    """Demšar 2006, table 5 and section 3.2.2: q = 2.569 for four methods at 0.05, and 1.25 on 14 data sets."""
    assert critical_difference(4, 14) == pytest.approx(2.569 * math.sqrt(4 * 5 / (6 * 14)), rel=1e-3)
    assert critical_difference(2, 10) == pytest.approx(1.960 * math.sqrt(2 * 3 / (6 * 10)), rel=1e-3)
    assert critical_difference(10, 10, 0.9) == pytest.approx(2.920 * math.sqrt(10 * 11 / (6 * 10)), rel=1e-3)


def test_two_methods_on_two_shapes_are_tested():
    """Without ties Friedman's statistic of two methods is (wins - losses)^2 / n, here 2."""
    found = average_ranks(np.array([[1.0, 2.0], [3.0, 5.0]]), np.ones((2, 2), bool), np.arange(2))
    assert (found.ranks.tolist(), found.blocks) == ([1, 2], 2)
    assert (found.statistic, found.p) == (pytest.approx(2), pytest.approx(math.erfc(1)))
    assert found.critical == pytest.approx(1.960 * math.sqrt(2 * 3 / (6 * 2)), rel=1e-3)


def test_equal_methods_have_equal_ranks_and_nothing_to_find():
    found = average_ranks(np.ones((6, 3)), np.ones((6, 3), bool), np.arange(6))
    assert found.ranks.tolist() == [2, 2, 2] and (found.statistic, found.p) == (0, 1)


def test_a_single_block_tells_nothing():
    found = average_ranks(np.array([[1.0, 2.0]]), np.ones((1, 2), bool), np.array([0]))
    assert found.ranks.tolist() == [1, 2]
    assert math.isnan(found.p) and math.isnan(found.critical)
