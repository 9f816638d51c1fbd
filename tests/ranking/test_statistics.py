"""Intervals and ranks, against closed forms, naive loops, scipy, and by how often they are right."""

import numpy as np
import pytest
from scipy import stats

from bench.ranking.statistics import (
    beyond,
    holm,
    mean_intervals,
    paired_differences,
    rank_intervals,
    skewness,
    standard_error,
)

TINY = 2.0**-40


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def intervals(case_means, level=0.95):
    """(n, k) case means -> mean, low, high."""
    return mean_intervals(case_means, np.ones_like(case_means), level)


def test_the_standard_error_is_the_classical_one_for_equal_counts(rng):
    x = rng.normal(size=(9, 4))
    assert standard_error(3 * x, np.full_like(x, 3)) == pytest.approx(stats.sem(x, axis=0))


def test_the_standard_error_is_what_the_bootstrap_tends_to(rng):
    sums, counts = rng.normal(5, 1, size=(12, 1)), rng.integers(2, 5, size=(12, 1)).astype(float)
    sums *= counts
    weights = rng.multinomial(12, np.full(12, 1 / 12), size=40_000)
    resampled = (weights @ sums) / (weights @ counts)
    assert standard_error(sums, counts)[0] == pytest.approx(resampled.std() * np.sqrt(12 / 11), rel=0.03)


def test_without_skewness_the_interval_is_students(rng):
    x = rng.normal(size=(5, 3))
    x = np.r_[x, 2 * x.mean(axis=0) - x]  # mirrored
    mean, low, high = intervals(x)
    half = stats.t.ppf(0.975, 9) * stats.sem(x, axis=0)
    assert low == pytest.approx(mean - half) and high == pytest.approx(mean + half)


def test_the_ends_are_where_halls_statistic_is_students_quantile(rng):
    x = np.exp(rng.normal(size=(9, 50))) * rng.choice([-1, 1], size=50)
    mean, low, high = intervals(x)
    for truth, quantile in ((low, stats.t.ppf(0.975, 8)), (high, stats.t.ppf(0.025, 8))):
        t, g, n = (mean - truth) / stats.sem(x, axis=0), stats.skew(x, axis=0), 9
        hall = t + g * t**2 / (3 * n**0.5) + g**2 * t**3 / (27 * n) + g / (6 * n**0.5)
        assert hall == pytest.approx(np.full(50, quantile))


def test_skewness_moves_the_interval_to_the_side_of_the_long_tail():
    mean, low, high = intervals(np.array([[1.0, 1, 2, 2, 2, 3, 3, 30]]).T)
    assert high - mean > 1.5 * (mean - low)


def test_skewness_is_that_of_the_cluster_means_whatever_their_counts(rng):
    x = np.exp(rng.normal(size=(9, 4)))
    assert skewness(3 * x, np.full_like(x, 3)) == pytest.approx(stats.skew(x, axis=0))
    assert skewness(1e-12 * x, np.ones_like(x)) == pytest.approx(stats.skew(x, axis=0))  # in any unit
    assert skewness(np.full((4, 1), 0.1), np.ones((4, 1))).tolist() == [0]
    assert skewness(np.zeros((4, 2)), np.array([[1.0, 0.0]] * 4)).tolist() == [0, 0]  # perfect, and never run


def test_a_higher_level_is_wider(rng):
    x = rng.normal(size=(6, 1))
    _, low, high = intervals(x, level=0.9)
    _, lower, higher = intervals(x, level=0.99)
    assert lower < low < high < higher


def test_one_cluster_or_none_has_no_interval():
    sums, counts = np.array([[1.0, 2.0, 0.0], [3.0, 0.0, 0.0]]), np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    mean, low, high = mean_intervals(sums, counts)
    assert mean[:2].tolist() == [2, 2]
    assert np.isnan(mean[2])
    assert np.isnan(low).tolist() == np.isnan(high).tolist() == [False, True, True]
    assert np.isnan(standard_error(np.array([1.0, 0.0]), np.array([49.0, 0.0])))  # 1 / 49 * 49 is not 1


@pytest.mark.parametrize("sign", [1, -1])
def test_the_mean_is_in_its_interval_at_any_level(sign):
    """A single hard shape of thirty: Hall's interval alone would be off the mean."""
    mean, low, high = intervals(sign * np.r_[np.zeros(29), 1.0][:, None], level=0.1)
    assert low <= mean <= high and low < high


def test_clusters_without_a_value_do_not_count():
    sums, counts = np.array([[1.0], [3.0], [0.0], [0.0]]), np.array([[1.0], [1.0], [0.0], [0.0]])
    mean, low, high = mean_intervals(sums, counts)
    assert mean[0] == 2
    # Two values: mean and standard error 1; Student's quantile for one degree of freedom.
    assert high[0] - low[0] == pytest.approx(2 * stats.t.ppf(0.975, 1))


def test_clusters_without_a_value_change_no_interval(rng):
    x = np.exp(rng.normal(size=(7, 3)))
    padded = mean_intervals(np.r_[x, np.zeros((5, 3))], np.r_[np.ones_like(x), np.zeros((5, 3))])
    assert padded == pytest.approx(np.array(intervals(x)))


@pytest.mark.parametrize("cases", [2, 4, 8, 20])
@pytest.mark.parametrize("seed_noise", [0.0, 3.0])
def test_coverage_is_as_promised_for_normal_cases_with_seeds(cases, seed_noise, rng):
    trials, seeds = 3000, 3
    x = rng.normal(size=(cases, 1, trials)) + seed_noise * rng.normal(size=(cases, seeds, trials))
    _, low, high = intervals(x.mean(axis=1))
    assert ((low <= 0) & (high >= 0)).mean() == pytest.approx(0.95, abs=0.015)


@pytest.mark.parametrize(("cases", "least"), [(4, 0.91), (8, 0.92), (20, 0.92)])
def test_coverage_of_skewed_scores_stays_near(cases, least, rng):
    x = np.exp(0.5 * rng.normal(size=(cases, 3000)))
    _, low, high = intervals(x)
    truth = np.exp(0.125)
    assert least < ((low <= truth) & (high >= truth)).mean() < 0.97


def test_paired_differences_against_a_naive_loop(rng):
    cases, seeds, k = 5, 3, 4
    values = np.exp(rng.normal(size=(cases * seeds, k, 2)))
    planned = rng.random(values.shape) > 0.2
    values[~planned] = np.nan
    difference, p = paired_differences(values, planned, np.arange(0, cases * seeds, seeds))
    for i in range(k):
        for j in range(k):
            for m in range(2):
                both = planned[:, i, m] & planned[:, j, m]
                a, b = values[both, i, m], values[both, j, m]
                assert difference[i, j, m] == pytest.approx((a - b).mean())
                relative = (a - b) / (a + b)
                if i == j or relative.mean() * (a - b).mean() <= 0:
                    assert p[i, j, m] == 1
                    continue
                case = (np.arange(cases * seeds) // seeds)[both]
                n = len(set(case))
                residual = np.array([(relative[case == c] - relative.mean()).sum() for c in set(case)])
                t = relative.mean() * len(a) / np.sqrt(n / (n - 1) * (residual**2).sum())
                assert p[i, j, m] == pytest.approx(2 * stats.t.sf(abs(t), n - 1))


@pytest.mark.parametrize(
    ("a", "b", "both", "difference", "p"),
    [
        ((3, 3, 3, 3), (1, 1, 1, 1), "", 0, 1),
        ((3, 3, 3, 3), (1, 1, 1, 1), "0", 2, 1),
        ((3, 3, 3, 3), (1, 1, 1, 1), "01", 2, 1),  # two seeds of one shape
        ((3, 3, 3, 3), (1, 1, 1, 1), "02", 2, 2 / 4**2),
        ((3, 3, 3, 3), (1, 1, 1, 1), "012", 2, 2 / 4**3),
        ((1, 1, 1, 1), (0, 0, 0, 0), "0123", 1, 2 / 4**4),  # yes or no
        ((3 * TINY,) * 4, (TINY,) * 4, "0123", 2 * TINY, 2 / 4**4),  # in any unit
        ((0, 0, 2, 2), (0, 0, 1, 1), "0123", 0.5, 0.5),  # both perfect on one shape: t = 1 with one degree of freedom
        ((1, 1, 102.5, 102.5), (1.5, 1.5, 102, 102), "0123", 0, 1),  # the relative difference is -0.1
    ],
)
def test_a_paired_difference_by_hand(a, b, both, difference, p):
    """Of two shapes with two seeds each."""
    values = np.array([a, b], dtype=float).T[..., None]
    planned = np.ones(values.shape, dtype=bool)
    planned[:, 1, 0] = [str(unit) in both for unit in range(4)]
    found = [array[..., 0] for array in paired_differences(values, planned, np.array([0, 2]))]
    np.testing.assert_allclose(found, [[[0, difference], [-difference, 0]], [[1, p], [p, 1]]], rtol=1e-12)


@pytest.mark.parametrize("cases", [2, 3, 9])
def test_with_one_seed_it_is_the_t_test(rng, cases):
    values = np.exp(rng.normal(size=(cases, 2, 1)) + [[0.0], [2.0]])
    _, p = paired_differences(values, np.ones_like(values, dtype=bool), np.arange(cases))
    a, b = values[:, 0, 0], values[:, 1, 0]
    assert (a - b).mean() * ((a - b) / (a + b)).mean() > 0
    assert p[0, 1, 0] == pytest.approx(stats.ttest_1samp((a - b) / (a + b), 0).pvalue)


def test_pairing_finds_what_two_separate_means_do_not(rng):
    hard = np.exp(1.5 * rng.normal(size=12))  # cases differ by factors
    a, b = hard * (1 + 0.02 * rng.random(12)), 1.1 * hard * (1 + 0.02 * rng.random(12))
    assert stats.ttest_ind(a, b).pvalue > 0.5
    values = np.c_[a, b][..., None]
    low, high, _ = rank_intervals(values, np.ones_like(values, dtype=bool), np.arange(12))
    assert low.ravel().tolist() == high.ravel().tolist() == [1, 2]


def test_rounding_is_a_tie(rng):
    a = 1 + rng.random(8)
    values = np.c_[a, a * (1 + 1e-14)][..., None]
    low, high, beaten = rank_intervals(values, np.ones_like(values, dtype=bool), np.arange(8))
    assert low.ravel().tolist() == [1, 1]
    assert high.ravel().tolist() == [2, 2]
    assert beaten.ravel().tolist() == [0, 0]


@pytest.mark.parametrize(("cases", "sure"), [(2, False), (3, True)])
def test_yes_no_results_need_three_units(cases, sure):
    values = np.zeros((cases, 2, 1))
    values[:, 1] = 1
    low, high, _ = rank_intervals(values, np.ones_like(values, dtype=bool), np.arange(cases))
    assert (low.ravel().tolist(), high.ravel().tolist()) == (([1, 2], [1, 2]) if sure else ([1, 1], [2, 2]))


def test_a_method_without_a_planned_unit_takes_no_part(rng):
    values = np.exp(rng.normal(size=(10, 3, 1)) * 0.01) * np.array([1.0, 2.0, 4.0])[:, None]
    planned = np.ones_like(values, dtype=bool)
    planned[:, 0] = False
    low, high, _ = rank_intervals(values, planned, np.arange(10))
    assert low.ravel()[1:].tolist() == high.ravel()[1:].tolist() == [1, 2]


def test_holm_by_hand():
    p = np.array([[0.012, 0.04, 0.03, 0.005], [0.02, 0.5, 0.5, 0.5]])
    # Row 1, alpha 0.05: 0.005 <= .0125, 0.012 <= .0167, 0.03 > .025: stop. Row 2: 0.02 > .0125.
    assert holm(p, 0.05).tolist() == [[True, False, False, True], [False] * 4]
    assert holm(np.array([[0.02, 1.0, 1.0]]), 0.05, np.array([2])).tolist() == [[True, False, False]]
    assert holm(np.array([[0.5, 0.25]]), 0.5).tolist() == [[True, True]]  # neither is above its level


@pytest.mark.parametrize(("k", "sure"), [(7, True), (8, False)])
def test_a_method_is_compared_with_all_others_that_take_part(k, sure):
    """One is right on four shapes and all others are wrong: 2 / 4^4 is less than 0.05 / 6, and more than 0.05 / 7."""
    values = np.ones((4, k + 1, 1))
    values[:, 0] = 0
    planned = np.ones(values.shape, dtype=bool)
    planned[:, k] = False
    low, high, beaten = rank_intervals(values, planned, np.arange(4))
    assert (low[0, 0], high[0, 0]) == (1, 1 if sure else k) and beaten.ravel().tolist() == [0, *[1] * (k - 1), 0]


def test_beyond_against_scipy(rng):
    """Of two to six clusters: those that lines lack beside longer ones count for nothing."""
    x, each = 1 + rng.normal(size=(6, 5)), np.arange(1.0, 6)
    there = np.arange(6)[:, None] < np.arange(2, 7)
    mean, low, high, p = beyond(np.where(there, each * x, 0), each * there, 0.7, 0.9)
    for column, n in enumerate(range(2, 7)):
        own = x[:n, column]
        reach = stats.t.ppf(0.95, n - 1) * stats.sem(own)
        assert (mean[column], low[column], high[column]) == pytest.approx(
            (own.mean(), own.mean() - reach, own.mean() + reach)
        )
        assert p[column] == pytest.approx(stats.ttest_1samp(own, 0.7, alternative="greater").pvalue)


@pytest.mark.parametrize(
    ("sums", "counts", "mean", "p"),
    [
        ((0, 0), (0, 0), np.nan, 1),
        ((6, 0), (3, 0), 2, 1),
        ((6, 4), (3, 2), 2, 1 / 4**5),  # all of five units are above the bound
        ((3, 2), (3, 2), 1, 1),  # at the bound
        ((0, 0), (3, 2), 0, 1),
    ],
)
def test_beyond_without_any_spread(sums, counts, mean, p):
    found = np.ravel(beyond(np.array(sums, float)[:, None], np.array(counts, float)[:, None], 1.0))
    width = 0 if min(counts) else np.nan
    np.testing.assert_array_equal(found, [mean, mean - width, mean + width, p])


@pytest.mark.parametrize("cases", [4, 12])
def test_rank_intervals_of_equal_methods_are_full_as_often_as_promised(cases, rng):
    trials, seeds, k = 400, 2, 6
    hard = np.exp(rng.normal(size=(cases, 1, 1, trials)))
    values = hard * np.exp(0.3 * rng.normal(size=(cases, seeds, k, trials)))
    values = values.reshape(cases * seeds, k, trials)
    starts = np.arange(0, cases * seeds, seeds)
    low, high, _ = rank_intervals(values, np.ones_like(values, dtype=bool), starts)
    assert ((low == 1) & (high == k)).mean() > 0.94


def test_blocks_change_nothing(rng, monkeypatch):
    values = np.exp(rng.normal(size=(12, 7, 2)))
    planned = rng.random(values.shape) > 0.1
    whole = rank_intervals(values, planned, np.arange(12))
    monkeypatch.setattr("bench.ranking.statistics._BLOCK", 500)
    for a, b in zip(whole, rank_intervals(values, planned, np.arange(12)), strict=True):
        assert (a == b).all()
