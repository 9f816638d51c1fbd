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
* Ranks: each two methods are compared on the units (case and seed) that both were run on, by the paired relative
  difference (a - b) / (|a| + |b|) and Student's t over the clusters. Relative, because the error on a hard case is a
  multiple of that on an easy one, and so is the difference of two methods: the plain difference would mostly measure
  how unlike the cases are (Fleming and Wallace, *Comm. ACM* 29, 1986, on normalised results). A method is surely better
  only if its mean is better too. The standard error is what the paired bootstrap tends to with infinitely many
  resamples; levels as small as many comparisons ask for could not be read off 2,000.
* Each rank interval holds at the chosen level for its own method, as each mean's interval does: Holm's correction
  (*Scand. J. Statist.* 6, 1979) runs over the comparisons that involve this method (Mogstad, Romano, Shaikh and
  Wilhelm, "Inference for Ranks", *Review of Economic Studies* 91, 2024).
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
        resampled = (sums.T @ weights.T) / (counts.T @ weights.T)
    # A resample may hold only clusters without a value: NaN, sorted to the end. It is as if it had not been drawn.
    resampled.sort(axis=1)
    last = (~np.isnan(resampled)).sum(axis=1, keepdims=True) - 1
    low, high = (_sorted_quantile(resampled, last, q) for q in (tail, 1 - tail))
    return np.maximum(mean - low, 0), np.maximum(high - mean, 0)


def _sorted_quantile(rows: np.ndarray, last: np.ndarray, q: float) -> np.ndarray:
    """The quantile of each sorted row up to its index ``last``, linear between neighbours."""
    below = np.floor(q * last).astype(int)
    left, right = (np.take_along_axis(rows, np.minimum(i, last), axis=1) for i in (below, below + 1))
    return (left + (q * last - below) * (right - left))[:, 0]


def paired_differences(values: np.ndarray, planned: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean paired difference of each two methods, and the two-sided p-value of the relative one.

    Parameters
    ----------
    values : (units, k, m) array
        One row per case and seed, one column per method, one layer per metric; ignored where not planned.
    planned : (units, k, m) bool array
        Whether the method was to solve the unit. A pair is compared on the units that both have.
    starts : (n,) int array
        The first unit of each cluster; units of a cluster are neighbours.

    Returns
    -------
    difference : (k, k, m) array
        ``difference[i, j]`` is the mean of ``values[:, i] - values[:, j]``; 0 without a common unit.
    p : (k, k, m) array
        1 where nothing is known: fewer than two common clusters, no difference, or a relative difference whose sign
        is not that of the mean.
    """
    units, k, m = values.shape
    difference, p = np.zeros((k, k, m)), np.ones((k, k, m))
    values = np.where(planned, values, 0.0)
    step = max(1, _BLOCK // max(1, units * k * m))
    for first in range(0, k, step):
        mine = slice(first, min(first + step, k))
        a, b = values[:, mine, None], values[:, None, :]
        both = planned[:, mine, None] & planned[:, None, :]
        size = abs(a) + abs(b)
        plain = np.where(both & (abs(a - b) > SAME * size), a - b, 0.0)
        relative = np.divide(plain, size, out=np.zeros_like(plain), where=size > 0)
        counts = np.add.reduceat(both.astype(float), starts)
        difference[mine] = plain.sum(axis=0) / np.maximum(counts.sum(axis=0), 1)
        p[mine] = _p_value(np.add.reduceat(relative, starts), counts, difference[mine])
    return difference, p


def _p_value(sums: np.ndarray, counts: np.ndarray, difference: np.ndarray) -> np.ndarray:
    """Student's t of a mean over clusters against 0; 1 if its sign is not that of ``difference``."""
    n, units = (counts > 0).sum(axis=0), counts.sum(axis=0)
    mean, error = sums.sum(axis=0) / np.maximum(units, 1), np.nan_to_num(standard_error(sums, counts))
    with np.errstate(divide="ignore", invalid="ignore"):
        p = 2 * special.stdtr(np.maximum(n - 1.0, 1.0), -abs(mean / error))
    # The same difference in every unit, as yes/no metrics give it, has no spread to measure it by. Two methods whose
    # answers are independent throws of one coin differ so, one way or the other, with probability 2 / 4^units at most.
    p = np.where(error <= SAME, 2 * 0.25**units, p)
    return np.where((n > 1) & (mean * difference > 0), p, 1.0)


def holm(p: np.ndarray, alpha: float, hypotheses: np.ndarray | int | None = None) -> np.ndarray:
    """Which hypotheses Holm's step-down procedure rejects.

    Parameters
    ----------
    p : (families, h) array
        Each row is one family of hypotheses.
    alpha : float
        Chance of any false rejection in a family.
    hypotheses : (families,) int array, optional
        How many of a row are real, where the others are padding with p = 1.

    Returns
    -------
    rejected : (families, h) bool array
    """
    size = np.broadcast_to(p.shape[1] if hypotheses is None else hypotheses, len(p))
    order = np.argsort(p, axis=1, kind="stable")
    left = np.maximum(size[:, None] - np.arange(p.shape[1]), 1)
    passed = np.logical_and.accumulate(np.take_along_axis(p, order, axis=1) <= alpha / left, axis=1)
    rejected = np.empty_like(passed)
    np.put_along_axis(rejected, order, passed, axis=1)
    return rejected


def sure_differences(
    values: np.ndarray, planned: np.ndarray, starts: np.ndarray, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray]:
    """Which two methods surely differ, for each metric.

    Parameters
    ----------
    values, planned, starts
        As in :func:`paired_differences`. A method without a planned unit takes no part.

    Returns
    -------
    difference : (k, k, m) array
        Of :func:`paired_differences`.
    sure : (k, k, m) bool array
        ``sure[i, j]``: i and j differ, by Holm's procedure over the comparisons of method i. It need not be
        ``sure[j, i]``, whose family is another one.
    """
    k, m = values.shape[1:]
    difference, p = paired_differences(values, planned, starts)
    taking_part = planned.any(axis=0).sum(axis=0)
    rejected = holm(p.transpose(2, 0, 1).reshape(m * k, k), 1 - level, np.repeat(taking_part - 1, k))
    return difference, rejected.reshape(m, k, k).transpose(1, 2, 0) & (p < 1)


def rank_intervals(
    values: np.ndarray, planned: np.ndarray, starts: np.ndarray, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Between which ranks each method lies, for each metric; 1 is the smallest value.

    Parameters
    ----------
    values, planned, starts
        As in :func:`paired_differences`; lower values are better. A method without a planned unit takes no part.

    Returns
    -------
    low, high : (k, m) int arrays
        ``low = 1 + number of methods surely better``, ``high = k - number surely worse``, of the k that take part.
    beaten_by : (k, m) int array
        How many methods have the better paired mean, sure or not: the order to print ties in.
    """
    return ranks_of(*sure_differences(values, planned, starts, level), planned)


def ranks_of(
    difference: np.ndarray, sure: np.ndarray, planned: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """:func:`rank_intervals` from the :func:`sure_differences` of the same ``planned``."""
    taking_part = planned.any(axis=0).sum(axis=0)
    low = 1 + (sure & (difference > 0)).sum(axis=1)
    high = taking_part - (sure & (difference < 0)).sum(axis=1)
    return low, high, (difference > 0).sum(axis=1)
