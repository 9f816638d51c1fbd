"""Intervals of means and of ranks, from few shapes with several measurements each.

The unit that is drawn from a population is the **shape**; the seeds of one shape, and its sensors,
share its difficulty. All functions therefore take sums and counts per *cluster*: per shape, or, where there is one
shape only, per seed of that shape. The spread of the cluster means already holds the spread within the clusters; to
count the units as independent would make intervals too narrow (Field and Welsh, *J. R. Statist. Soc. B* 69, 2007).

* Means: Student's t over the clusters, with the skewness of the scores removed by Hall's transformation ("On the
  Removal of Skewness by Transformation", *J. R. Statist. Soc. B* 54, 1992). Errors are skewed: a few hard shapes have
  most of it, and a sample without them looks better and more certain than it is, so that Student's interval, and the
  bootstrap's, miss the true mean on one side. The transformed statistic is nearly normal; it is compared with
  Student's quantile rather than the normal one, for few clusters. Without skewness the interval is Student's.
  ``tests/ranking/test_statistics.py`` and ``tests/ranking/test_leaderboard_clusters.py`` measure the coverage.
* Ranks: all pairs of methods are compared on the units (shape, seed and sensor) that both were run on, by the paired
  relative difference (a - b) / (|a| + |b|) and Student's t over the clusters. Relative, because the error on a hard
  case is a multiple of that on an easy one, and so is the difference of two methods: the plain difference would mostly
  measure how unlike the cases are (Fleming and Wallace, *Comm. ACM* 29, 1986, on normalised results). A method is
  significantly better only if its mean is better too. No skewness is removed here: the relative difference of two
  equally good methods is as often negative as positive.
* Each rank interval holds at the chosen level for its own method, as each mean's interval does: Holm's correction
  (*Scand. J. Statist.* 6, 1979) runs over the comparisons that involve this method (Mogstad, Romano, Shaikh and
  Wilhelm, "Inference for Ranks", *Review of Economic Studies* 91, 2024).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

SAME = 1e-9  # two means closer than this, relative to their size, are a tie: rounding must not decide
_BLOCK = 2_000_000  # numbers held at once


def student_quantile(probability: float | np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """Quantile of Student's t; ``scipy.special`` has it without the weight of ``scipy.stats``."""
    return special.stdtrit(freedom, probability)


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
    sums: np.ndarray, counts: np.ndarray, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means over clusters with their confidence intervals.

    With T = (mean - truth) / (standard error), n clusters and their skewness g, Hall's statistic is
    ``T + g T^2 / (3 sqrt n) + g^2 T^3 / (27 n) + g / (6 sqrt n)``; the ends of the interval are where it is Student's
    quantile.

    Parameters
    ----------
    sums, counts : (n, k) arrays
        Per cluster and quantity, as in :func:`standard_error`.
    level : float
        The confidence level.

    Returns
    -------
    mean, low, high : (k,) arrays
        ``low`` and ``high`` are NaN where fewer than two clusters have values: one shape tells nothing about others.
    """
    n = (counts > 0).sum(axis=0)
    root = np.sqrt(np.maximum(n, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = sums.sum(axis=0) / counts.sum(axis=0)
    error, skew = standard_error(sums, counts), skewness(sums, counts)
    t = student_quantile((1 + level) / 2, np.maximum(n - 1.0, 1.0))
    reach = [root * error * _untransformed((q - skew / (6 * root)) / root, skew) for q in (t, -t)]
    return mean, mean - np.maximum(reach[0], 0), mean - np.minimum(reach[1], 0)


def skewness(sums: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Skewness of the cluster means, as in :func:`standard_error`; 0 where they do not differ."""
    n = (counts > 0).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        residuals = sums - sums.sum(axis=0) / counts.sum(axis=0) * counts
        size = np.sqrt((residuals**2).sum(axis=0) / n)
        skew = (residuals**3).sum(axis=0) / n / size**3
    return np.where(size > SAME * abs(sums).max(axis=0, initial=0), skew, 0.0)


def _untransformed(y: np.ndarray, skew: np.ndarray) -> np.ndarray:
    """The x with ``x + skew x^2 / 3 + skew^2 x^3 / 27 = y``, whose left side is ``((1 + skew x / 3)^3 - 1) / skew``."""
    straight = abs(skew) < 1e-6
    safe = np.where(straight, 1.0, skew)
    return np.where(straight, y, 3 / safe * (np.cbrt(1 + safe * y) - 1))


def paired_differences(values: np.ndarray, planned: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean paired difference of each two methods, and the two-sided p-value of the relative one.

    Parameters
    ----------
    values : (units, k, m) array
        One row per case and seed, one column per method, one layer per metric; ignored where not planned.
    planned : (units, k, m) bool array
        Whether the unit was planned for the method. A pair is compared on the units that both have.
    starts : (n,) int array
        The first unit of each cluster; units of a cluster are neighbours.

    Returns
    -------
    difference : (k, k, m) array
        ``difference[i, j]`` is the mean of ``values[:, i] - values[:, j]``; 0 without a common unit.
    p : (k, k, m) array
        1 if nothing is known: fewer than two common clusters, no difference, or a relative difference whose sign
        is not that of the mean.
    """
    units, k, m = values.shape
    difference, p = np.zeros((k, k, m)), np.ones((k, k, m))
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


def p_without_spread(units: np.ndarray) -> np.ndarray:
    """The two-sided p-value of a difference that is the same in every unit, as with yes/no metrics.

    It has no measurable spread. Two methods whose answers are independent tosses of one coin differ so, in either
    direction, with probability 2 / 4^units at most.
    """
    return 2 * 0.25**units


def _p_value(sums: np.ndarray, counts: np.ndarray, difference: np.ndarray) -> np.ndarray:
    """Student's t of a mean over clusters against 0; 1 if its sign is not that of ``difference``."""
    n, units = (counts > 0).sum(axis=0), counts.sum(axis=0)
    mean, error = sums.sum(axis=0) / np.maximum(units, 1), np.nan_to_num(standard_error(sums, counts))
    with np.errstate(divide="ignore", invalid="ignore"):
        p = 2 * special.stdtr(np.maximum(n - 1.0, 1.0), -abs(mean / error))
    p = np.where(error <= SAME, p_without_spread(units), p)
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
        The number of real ones in a row, if the others are padding with p = 1.

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


def holm_p(p: Sequence[float]) -> list[float]:
    """The p-values of one family as Holm's procedure corrects them: rejected at alpha if they are not above it.

    Example
    -------
    >>> holm_p([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    found, least = [0.0] * len(p), 0.0
    for i, k in enumerate(sorted(range(len(p)), key=lambda k: p[k])):
        least = max(least, min(1.0, (len(p) - i) * p[k]))
        found[k] = least
    return found


def significant_differences(
    values: np.ndarray, planned: np.ndarray, starts: np.ndarray, level: float
) -> tuple[np.ndarray, np.ndarray]:
    """Which two methods significantly differ, for each metric.

    Parameters
    ----------
    values, planned, starts
        As in :func:`paired_differences`. A method without a planned unit takes no part.

    Returns
    -------
    difference : (k, k, m) array
        Of :func:`paired_differences`.
    significant : (k, k, m) bool array
        ``significant[i, j]``: i and j differ, by Holm's procedure over the comparisons of method i. It need not be
        ``significant[j, i]``, whose family is another one.
    """
    k, m = values.shape[1:]
    difference, p = paired_differences(values, planned, starts)
    taking_part = planned.any(axis=0).sum(axis=0)
    rejected = holm(p.transpose(2, 0, 1).reshape(m * k, k), 1 - level, np.repeat(taking_part - 1, k))
    return difference, rejected.reshape(m, k, k).transpose(1, 2, 0)


def rank_intervals(
    values: np.ndarray, planned: np.ndarray, starts: np.ndarray, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The interval of the rank of each method, for each metric; 1 is the smallest value.

    Parameters
    ----------
    values, planned, starts
        As in :func:`paired_differences`; lower values are better. A method without a planned unit takes no part.

    Returns
    -------
    low, high : (k, m) int arrays
        ``low = 1 + number of methods significantly better``, ``high = k - number significantly worse``, of the k that
        take part.
    beaten_by : (k, m) int array
        How many methods have the better paired mean, significantly or not: the order to print ties in.
    """
    return ranks_of(*significant_differences(values, planned, starts, level), planned)


def ranks_of(
    difference: np.ndarray, significant: np.ndarray, planned: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """:func:`rank_intervals` from the :func:`significant_differences` of the same ``planned``."""
    taking_part = planned.any(axis=0).sum(axis=0)
    low = 1 + (significant & (difference > 0)).sum(axis=1)
    high = taking_part - (significant & (difference < 0)).sum(axis=1)
    return low, high, (difference > 0).sum(axis=1)


def beyond(
    sums: np.ndarray, counts: np.ndarray, bound: float | np.ndarray, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Means over clusters with Student's intervals, and how certain it is that each mean is above a bound.

    For paired relative differences, whose skewness is not removed (see above).

    Parameters
    ----------
    sums, counts : (n, k) arrays
        Per cluster and quantity, as in :func:`standard_error`.
    bound : float or (k,) array
        The bound to which the means are compared.
    level : float
        The confidence level of the intervals.

    Returns
    -------
    mean, low, high : (k,) arrays
        ``low`` and ``high`` are NaN where fewer than two clusters have values.
    p : (k,) array
        One-sided: the chance of such a mean if the true one is not above the bound. 1 if nothing is known.
    """
    n, units = (counts > 0).sum(axis=0), counts.sum(axis=0)
    error = standard_error(sums, counts)
    freedom = np.maximum(n - 1.0, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = sums.sum(axis=0) / units
        p = special.stdtr(freedom, -(mean - bound) / error)
    # Without any spread, as in paired_differences: all units lie on one side of the bound.
    p = np.where(error <= SAME, np.where(mean > bound, p_without_spread(units) / 2, 1.0), p)
    reach = student_quantile((1 + level) / 2, freedom) * error
    return mean, mean - reach, mean + reach, np.where(n > 1, p, 1.0)
