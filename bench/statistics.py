"""Intervals of means and of ranks, from few cases that each were run with several seeds.

The unit that is drawn from a population is the **case**; the seeds of one case share its difficulty. All functions
therefore take sums and counts per *cluster*: per case, or, where there is one case only, per seed of that case.

* Whole clusters are resampled, and what is inside comes along. The spread of the cluster means already holds the
  spread between seeds; resampling the seeds of a case once more would count it twice (Davison and Hinkley, *Bootstrap
  Methods and their Application*, 1997, section 3.8; Field and Welsh, *J. R. Statist. Soc. B* 69, 2007).
* The percentile interval is too narrow for few cases (Hesterberg, "What Teachers Should Know About the Bootstrap",
  *The American Statistician* 69, 2015): it lacks Student's t quantile and the factor sqrt(n / (n - 1)). Widening the
  percentile level, as Hesterberg does, ends at the smallest and largest case, which for four cases covers 88 %. So the
  percentile interval is stretched instead: the bootstrap says how the width is shared between the two sides, and the
  width is Student's. ``tests/test_statistics.py`` measures the coverage.
* Ranks: pairs are compared on the cases that both were run on, by the paired difference and its standard error. That
  error is the one that the paired bootstrap on the same resamples tends to with infinitely many of them, and needs no
  drawing; levels as small as those that many comparisons ask for could not be read off 2,000 resamples. Each method's
  rank interval holds at the chosen level for itself, as each mean's interval does: Holm's correction (*Scand. J.
  Statist.* 6, 1979) runs over the comparisons that involve this method (Mogstad, Romano, Shaikh and Wilhelm, "Inference
  for Ranks", *Review of Economic Studies* 91, 2024).
"""

from __future__ import annotations

import numpy as np
from scipy import special

SAME = 1e-9  # two means closer than this, relative to their size, are a tie: rounding decides nothing
_BLOCK = 2_000_000  # numbers held at once


def student_quantile(probability: float | np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """Quantile of Student's t; ``scipy.special`` has it without the weight of ``scipy.stats``."""
    return special.stdtrit(freedom, probability)


def resampling_weights(clusters: int, resamples: int, rng: np.random.Generator) -> np.ndarray:
    """How often each cluster is drawn in each bootstrap sample.

    Returns
    -------
    weights : (resamples, clusters) array
        Whole numbers; each row adds to ``clusters``.
    """
    return rng.multinomial(clusters, np.full(clusters, 1 / clusters), size=resamples).astype(float)


def standard_error(sums: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Standard error of a mean over clusters, ``sum(sums) / sum(counts)``.

    Parameters
    ----------
    sums, counts : (n, ...) arrays
        Per cluster: the sum of the values and how many they are. A cluster without values is left out.

    Returns
    -------
    (...) array
        NaN where fewer than two clusters have values. For equal counts it is the classical s / sqrt(n) of the cluster
        means, else the linearised error of a ratio.
    """
    n = (counts > 0).sum(axis=0)
    total = counts.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        residuals = sums - sums.sum(axis=0) / total * counts
        error = np.sqrt(n / (n - 1) * (residuals**2).sum(axis=0)) / total
    return np.where(n > 1, error, np.nan)


def mean_intervals(
    sums: np.ndarray, counts: np.ndarray, weights: np.ndarray, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means over clusters with their bootstrap intervals.

    Parameters
    ----------
    sums, counts : (n, k) arrays
        Per cluster and quantity, as in :func:`standard_error`.
    weights : (resamples, n) array
        From :func:`resampling_weights`; the same for all quantities.
    level : float
        The confidence level.

    Returns
    -------
    mean, low, high : (k,) arrays
        ``low`` and ``high`` are NaN where fewer than two clusters have values: one case says nothing of others.
    """
    n = (counts > 0).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(n > 0, sums.sum(axis=0) / counts.sum(axis=0), np.nan)
    low, high = np.full(mean.shape, np.nan), np.full(mean.shape, np.nan)
    tail = (1 - level) / 2
    known = np.flatnonzero(n > 1)
    for block in np.array_split(known, max(1, -(-len(known) * len(weights) // _BLOCK))):
        if not len(block):
            continue
        below, above = _percentile_sides(sums[:, block], counts[:, block], weights, mean[block], tail)
        width = 2 * student_quantile(1 - tail, n[block] - 1.0) * standard_error(sums[:, block], counts[:, block])
        both = below + above
        share = np.divide(below, both, out=np.full(both.shape, 0.5), where=both > 0)
        low[block] = mean[block] - share * width
        high[block] = mean[block] + (1 - share) * width
    return mean, low, high


def _percentile_sides(
    sums: np.ndarray, counts: np.ndarray, weights: np.ndarray, mean: np.ndarray, tail: float
) -> tuple[np.ndarray, np.ndarray]:
    """How far the percentile interval reaches below and above the mean."""
    with np.errstate(divide="ignore", invalid="ignore"):
        resampled = np.ascontiguousarray(((weights @ sums) / (weights @ counts)).T)
    # A resample may hold only clusters without a value; it is as if it had not been drawn.
    quantile = np.nanquantile if np.isnan(resampled).any() else np.quantile
    low, high = quantile(resampled, [tail, 1 - tail], axis=1)
    return np.maximum(mean - low, 0), np.maximum(high - mean, 0)


def paired_differences(values: np.ndarray, planned: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean paired difference of each two columns, and its two-sided p-value.

    Parameters
    ----------
    values : (units, k) array
        One row per case and seed, one column per method; ignored where not planned.
    planned : (units, k) bool array
        Whether the method was to solve the unit. A pair is compared on the units that both have.
    starts : (n,) int array
        The first unit of each cluster; units of a cluster are neighbours.

    Returns
    -------
    difference : (k, k) array
        ``difference[i, j]`` is the mean of ``values[:, i] - values[:, j]``; 0 without a common unit.
    p : (k, k) array
        1 where nothing is known: fewer than two common clusters, or no difference.
    """
    units, k = values.shape
    difference, p = np.zeros((k, k)), np.ones((k, k))
    values = np.where(planned, values, 0.0)
    step = max(1, _BLOCK // max(1, units * k))
    for first in range(0, k, step):
        mine = slice(first, min(first + step, k))
        both = (planned[:, mine, None] & planned[:, None, :]).astype(float)
        sums = np.add.reduceat((values[:, mine, None] - values[:, None, :]) * both, starts, axis=0)
        sizes = np.add.reduceat((abs(values[:, mine, None]) + abs(values[:, None, :])) * both, starts, axis=0)
        counts = np.add.reduceat(both, starts, axis=0)
        difference[mine], p[mine] = _paired_test(sums, sizes, counts)
    return difference, p


def _paired_test(sums: np.ndarray, sizes: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n = (counts > 0).sum(axis=0)
    total = np.maximum(counts.sum(axis=0), 1)
    difference = sums.sum(axis=0) / total
    size = sizes.sum(axis=0) / total
    difference = np.where(abs(difference) <= SAME * size, 0.0, difference)
    error = np.nan_to_num(standard_error(sums, counts))
    constant = error <= SAME * size
    with np.errstate(divide="ignore", invalid="ignore"):
        p = 2 * special.stdtr(np.maximum(n - 1.0, 1.0), -abs(difference / error))
    # The same difference in every case, as yes/no metrics give it, has no spread to measure it by. Two methods whose
    # answers are independent coins differ so, one way or the other, with probability 2 / 4^n at most.
    p = np.where(constant, 2 * 0.25**n, p)
    return difference, np.where((n > 1) & (difference != 0), p, 1.0)


def holm(p: np.ndarray, alpha: float) -> np.ndarray:
    """Which hypotheses Holm's step-down procedure rejects, row by row.

    Parameters
    ----------
    p : (rows, m) array
        Each row is one family of hypotheses.

    Returns
    -------
    rejected : (rows, m) bool array
    """
    m = p.shape[1]
    order = np.argsort(p, axis=1, kind="stable")
    ordered = np.take_along_axis(p, order, axis=1)
    passed = np.logical_and.accumulate(ordered <= alpha / np.arange(m, 0, -1), axis=1)
    rejected = np.empty_like(passed)
    np.put_along_axis(rejected, order, passed, axis=1)
    return rejected


def rank_intervals(
    values: np.ndarray, planned: np.ndarray, starts: np.ndarray, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Between which ranks each method lies; 1 is the smallest value.

    Parameters
    ----------
    values, planned, starts
        As in :func:`paired_differences`; lower values are better.

    Returns
    -------
    low, high : (k,) int arrays
        ``low = 1 + number of methods surely better``, ``high = k - number surely worse``.
    beaten_by : (k,) int array
        How many methods have the better paired mean, sure or not: the order to print ties in.
    """
    k = values.shape[1]
    difference, p = paired_differences(values, planned, starts)
    others = ~np.eye(k, dtype=bool)
    sure = np.zeros((k, k), dtype=bool)
    if k > 1:
        sure[others] = holm(p[others].reshape(k, k - 1), 1 - level).ravel()
    low = 1 + (sure & (difference > 0)).sum(axis=1)
    high = k - (sure & (difference < 0)).sum(axis=1)
    return low, high, (difference > 0).sum(axis=1)
