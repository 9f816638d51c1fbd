"""Pairwise comparison of methods: how often one is better than the other, and their average ranks.

* **Win rate** (probability of improvement; Agarwal, Schwarzer, Castro, Courville and Bellemare, "Deep Reinforcement
  Learning at the Edge of the Statistical Precipice", NeurIPS 2021): the share of units (shape, seed and sensor) on
  which a method is better than another, a tie counting half. Methods are compared on the same units, so pairs are of
  one unit, where the paper takes all pairs of runs. Shapes are clusters: the rate of a shape is that over its units,
  and the interval is over shapes.
* **Average ranks** (Friedman, *J. Am. Stat. Assoc.* 32, 1937; Demšar, "Statistical Comparisons of Classifiers over
  Multiple Data Sets", *JMLR* 7, 2006): methods are ranked on each unit, the ranks of a shape's units are averaged, and
  the shape is one block with the ranks of these averages. Two methods whose average ranks differ by less than the
  critical difference of Nemenyi's test, ``q sqrt(k (k + 1) / (6 n))``, do not differ significantly by that test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from .statistics import SAME, mean_intervals


def win_rates(
    values: np.ndarray, planned: np.ndarray, starts: np.ndarray, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """How often each method is better than each other method.

    Parameters
    ----------
    values : (units, k) array
        Lower is better.
    planned : (units, k) bool array
        Whether the unit was planned for the method. A pair is compared on the units that both have.
    starts : (n,) int array
        The first unit of each cluster; units of a cluster are neighbours.
    level : float
        Of the intervals.

    Returns
    -------
    rate, low, high : (k, k) arrays
        ``rate[i, j]`` is the share of units on which i is better than j, with ties as a half; NaN without a common
        unit. The interval is NaN with fewer than two common clusters.
    clusters : (k, k) array
        How many clusters the pair has in common.
    """
    k = values.shape[1]
    a, b = values[:, :, None], values[:, None, :]
    both = planned[:, :, None] & planned[:, None, :]
    with np.errstate(invalid="ignore"):
        tie = abs(a - b) <= SAME * (abs(a) + abs(b))
        won = np.where(both, np.where(tie, 0.5, a < b), 0.0)
    sums = np.add.reduceat(won, starts).reshape(len(starts), k * k)
    counts = np.add.reduceat(both.astype(float), starts).reshape(len(starts), k * k)
    rate, low, high = (array.reshape(k, k) for array in mean_intervals(sums, counts, level))
    clusters = (counts > 0).sum(axis=0).reshape(k, k)
    # For a method that always wins, the shapes have no spread; the interval of a binomial share (Clopper and
    # Pearson, Biometrika 26, 1934) bounds the rate of losses that so few shapes did not show.
    with np.errstate(divide="ignore"):
        rare = ((1 - level) / 2) ** (1 / clusters)
    low, high = np.where(rate == 1, rare, low), np.where(rate == 0, 1 - rare, high)
    known = clusters > 1
    return rate, np.where(known, np.maximum(low, 0), np.nan), np.where(known, np.minimum(high, 1), np.nan), clusters


@dataclass(frozen=True)
class AverageRanks:
    """The average ranks of methods over blocks, and their tests."""

    ranks: np.ndarray  # (k,) from 1; NaN without a block
    blocks: int  # shapes with all units planned for all methods
    statistic: float  # Friedman's, corrected for ties; NaN with fewer than two blocks or methods
    p: float  # that all methods are equally good
    critical: float  # the critical difference of Nemenyi's test


def average_ranks(values: np.ndarray, planned: np.ndarray, starts: np.ndarray, level: float = 0.95) -> AverageRanks:
    """Friedman's test and the critical difference of Nemenyi's.

    Parameters
    ----------
    values, planned, starts
        As in :func:`win_rates`. Units not planned for some method are left out.
    level : float
        One minus the size of the tests.
    """
    units, k = values.shape
    block = np.searchsorted(starts, np.arange(units), side="right")
    whole = planned.all(axis=1)
    ranked = ranks_within(values[whole])
    kept, place = np.unique(block[whole], return_inverse=True)
    n = len(kept)
    if n < 2 or k < 2:
        return AverageRanks(ranked.mean(axis=0) if n else np.full(k, np.nan), n, math.nan, math.nan, math.nan)
    sums = np.zeros((n, k))
    np.add.at(sums, place, ranked)
    ranks = ranks_within(sums)  # of one shape, sums rank as averages do
    return AverageRanks(ranks.mean(axis=0), n, *_friedman(ranks), critical_difference(k, n, level))


def ranks_within(values: np.ndarray) -> np.ndarray:
    """(n, k) ranks from 1 within each row; equal values (up to rounding) share their average rank."""
    order = np.argsort(values, axis=1, kind="stable")
    ordered = np.take_along_axis(values, order, axis=1)
    ranks = np.empty(values.shape)
    for row in range(len(values)):
        line = ordered[row]
        step = np.diff(line) > SAME * (abs(line[1:]) + abs(line[:-1]))
        tie = np.r_[0, np.cumsum(step)]
        mean = np.bincount(tie, np.arange(1, len(line) + 1)) / np.bincount(tie)
        ranks[row, order[row]] = mean[tie]
    return ranks


def _friedman(ranks: np.ndarray) -> tuple[float, float]:
    """Friedman's statistic of (n, k) ranks, corrected for ties, and its p-value by the chi-squared distribution."""
    from scipy import special

    n, k = ranks.shape
    spread = ((ranks - (k + 1) / 2) ** 2).sum()
    if spread == 0:  # all are equal on all shapes
        return 0.0, 1.0
    statistic = (k - 1) * (ranks.sum(axis=0) - n * (k + 1) / 2).__pow__(2).sum() / spread
    return float(statistic), float(special.chdtrc(k - 1, statistic))


@cache
def critical_difference(k: int, n: int, level: float = 0.95) -> float:
    """The least difference of two average ranks that Nemenyi's test detects, for k methods and n blocks.

    Example
    -------
    >>> round(critical_difference(4, 14), 2)  # Demšar 2006, section 3.2.2: 2.569 sqrt(4 * 5 / (6 * 14))
    1.25
    """
    from scipy.stats import studentized_range

    quantile = float(studentized_range.ppf(level, k, np.inf)) / math.sqrt(2)
    return quantile * math.sqrt(k * (k + 1) / (6 * n))
