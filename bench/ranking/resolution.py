"""The resolution of a table: significant differences, practical equivalence, and the effect of more shapes.

All is about the paired relative differences d = (a - b) / (|a| + |b|) that the ranks are made of, see
:mod:`statistics`, over n clusters (shapes), whose spread is s. To a reader they are given as a ratio: "12 %" is
a result 1.12 times as large as the other, for which d = 0.12 / 2.12.

* The smallest difference that n shapes can detect is that for which the paired t test at the table's level has a power
  of 80 %: d = s / sqrt(n) * L, with L the noncentrality for which P(t'(n - 1; L) > t(n - 1)) = 0.8 (Cohen,
  *Statistical Power Analysis for the Behavioral Sciences*, 2nd ed. 1988, chapter 2; the noncentral t is exact here, and
  matters for few shapes). The level is divided by the comparisons of the two methods that are still open, as Holm's
  step for this one would be. The same formula, with the observed difference, gives the number of shapes that would
  separate two methods.
* "Equal within 2 %" is a separate claim, not the absence of a difference: two one-sided tests (Schuirmann, "A
  Comparison of the Two One-Sided Tests Procedure and the Power Approach", *J. Pharmacokinet. Biopharm.* 15, 1987)
  reject that a is 2 % or more above b, and that it is as much below: at the level 95 %, the 90 % interval of d lies
  within the region. Each such claim holds at the table's level by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from ..errors import UsageError
from .statistics import SAME, p_without_spread, standard_error, student_quantile

FEWEST = 4  # shapes that a table of ranks needs
POWER = 0.8
MOST = 1000  # more shapes than these are not counted
EQUAL = 0.02  # the usual region of practical equivalence, as a ratio less 1


def check_region(equal: float) -> None:
    """Raise :class:`UsageError` unless ``equal`` is a region of practical equivalence."""
    if not 0 < equal < 1:
        raise UsageError(f"equal {equal}: expected a share between 0 and 1, as 0.02 for 2 %")


def as_ratio(difference: np.ndarray) -> np.ndarray:
    """From (a - b) / (a + b) to a / b - 1; infinite from 1 on.

    Example
    -------
    >>> float(as_ratio(np.array(0.2)))
    0.5
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(difference < 1, 2 * difference / (1 - difference), np.inf)


def as_difference(ratio: float) -> float:
    """From a / b - 1 to (a - b) / (a + b): the inverse of :func:`as_ratio`."""
    return ratio / (2 + ratio)


def noncentrality(n: np.ndarray, alpha: np.ndarray, power: float = POWER) -> np.ndarray:
    """The true mean, in standard errors, that a two-sided t test of n values finds with this power.

    Parameters
    ----------
    n : (...) array
        How many values, at least 2; NaN if there are fewer.
    alpha : (...) array
        The level of the test; half of it is on the side of the mean.
    """
    freedom = np.maximum(n - 1, 1)
    found = special.nctdtrinc(freedom, 1 - power, student_quantile(1 - alpha / 2, freedom))
    return np.where(n > 1, found, np.nan)


def more_needed(
    mean: np.ndarray, spread: np.ndarray, n: np.ndarray, alpha: np.ndarray, units: np.ndarray | float = 1.0
) -> np.ndarray:
    """How many more values the t test needs to find a mean with the power :data:`POWER`.

    Parameters
    ----------
    mean, spread : (...) arrays
        Taken to be the true ones.
    n, alpha : (...) arrays
        How many values there are, and the level of the test.
    units : (...) array or float
        Of how many measurements each value is the mean: these count where there is no spread.

    Returns
    -------
    (...) array
        NaN if no number suffices (a mean of 0, or fewer than two values); infinite beyond :data:`MOST`.
    """

    def enough(more: np.ndarray) -> np.ndarray:
        found = noncentrality(n + more, alpha) * spread <= abs(mean) * np.sqrt(n + more)
        return np.where(spread <= SAME * np.sqrt(n), p_without_spread(units * (n + more)) <= alpha, found)

    low, high = np.zeros(np.shape(mean)), np.full(np.shape(mean), float(MOST))
    within, now = enough(high), enough(low)
    while (high - low > 1).any():  # low is not enough, high is
        middle = np.floor((low + high) / 2)
        good = enough(middle)
        low, high = np.where(good, low, middle), np.where(good, middle, high)
    found = np.where(now, 0.0, np.where(within, high, np.inf))
    return np.where((abs(mean) > SAME) & (n > 1), found, np.nan)


@dataclass(frozen=True)
class Pairs:
    """Paired relative differences of two methods, over clusters; every array has one entry per pair and metric."""

    mean: np.ndarray
    error: np.ndarray  # standard error of the mean
    n: np.ndarray  # clusters that both were run on
    units: np.ndarray  # units that both were run on

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation of the clusters."""
        return self.error * np.sqrt(self.n)

    def within(self, region: float, level: float) -> np.ndarray:
        """Whether both one-sided tests at ``level`` find the mean inside ``-region`` to ``region``."""
        reach = student_quantile(level, self.n - 1.0) * self.error
        return (self.n >= FEWEST) & (abs(self.mean) + reach < region)


def pairs(values: np.ndarray, planned: np.ndarray, starts: np.ndarray, a: np.ndarray, b: np.ndarray) -> Pairs:
    """Compare method ``a[i, m]`` with ``b[i, m]`` on metric m.

    Parameters
    ----------
    values, planned, starts
        As of :func:`statistics.paired_differences`: (units, k, m), (units, k, m), first unit of each cluster.
    a, b : (p, m) int arrays
        Which methods.
    """
    layer = np.arange(values.shape[2])
    x, y = values[:, a, layer], values[:, b, layer]
    both = planned[:, a, layer] & planned[:, b, layer]
    size = abs(x) + abs(y)
    differ = both & (abs(x - y) > SAME * size)
    relative = np.divide(x - y, size, out=np.zeros_like(size), where=differ)
    sums, counts = np.add.reduceat(relative, starts), np.add.reduceat(both.astype(float), starts)
    units = counts.sum(axis=0)
    mean = sums.sum(axis=0) / np.maximum(units, 1)
    return Pairs(mean, standard_error(sums, counts), (counts > 0).sum(axis=0), units)


@dataclass(frozen=True)
class Standings:
    """The standings of the methods of a group by each metric: the input of :func:`resolve`.

    ``values`` (units, k, m; lower is better), ``planned`` (the same shape) and ``starts`` are what the ranks were made
    from; ``low``, ``high`` and ``order`` (k, m) the ranks; ``significant`` (k, k, m) tells which methods differ in the
    family of the first; ``shapes`` (k, m) on how many shapes a method was run.
    """

    values: np.ndarray
    planned: np.ndarray
    starts: np.ndarray
    low: np.ndarray
    high: np.ndarray
    order: np.ndarray
    significant: np.ndarray
    shapes: np.ndarray


def rankable(shapes: np.ndarray) -> np.ndarray:
    """(m,) bool array: by which metrics methods can be ranked, of (k, m) numbers of shapes."""
    return shapes.max(axis=0, initial=0) >= FEWEST


def resolve(standings: Standings, taking_part: np.ndarray, level: float, equal: float) -> dict[str, np.ndarray]:
    """The columns of a board that describe its resolution, each a (k, m) array.

    Parameters
    ----------
    standings : Standings
    taking_part : (k, m) bool array
        The methods that solved something; the others are not compared.
    level : float
        The confidence level of the ranks.
    equal : float
        The region of practical equivalence: 0.02 is 2 %.

    Returns
    -------
    dict
        ``shapes``, ``versus_next``, ``detectable``, ``more_shapes`` and ``versus_first``, see
        :data:`bench.ranking.leaderboard.COLUMNS`.
    """
    s = standings
    k, m = s.low.shape
    layer = np.arange(m)
    # The order that the lines are printed in, per metric; those that take no part come last.
    line = np.lexsort([np.broadcast_to(np.arange(k)[:, None], (k, m)), s.high, s.order, s.low, ~taking_part], axis=0)
    there = np.take_along_axis(taking_part, line, axis=0)
    here, following = line[:-1], line[1:]
    next_one = pairs(s.values, s.planned, s.starts, here, following)
    known = there[1:] & (next_one.n > 1) & rankable(s.shapes)
    apart = known & s.significant[here, following, layer] & s.significant[following, here, layer]
    # Holm's step: the comparisons of either method that are open, this one among them.
    left = np.maximum(s.high - s.low, 1)
    open_ones = np.maximum(left[here, layer], left[following, layer])
    alpha = (1 - level) / open_ones
    found = as_ratio(noncentrality(next_one.n, alpha) * next_one.error)
    # For the first two only; if the first one is not the better one by d, more shapes will not help.
    each = next_one.units / np.maximum(next_one.n, 1)
    top = [x[:1] for x in (np.minimum(next_one.mean, 0), next_one.spread, next_one.n, alpha, each)]
    more = more_needed(*top)
    # Found already and yet not significant: the means are equal, whatever the relative difference; they remain so.
    more = np.where(apart[:1], 0.0, np.where(more == 0, np.nan, more))
    first = pairs(s.values, s.planned, s.starts, np.broadcast_to(line[:1], (k, m)), line)
    alike = first.within(as_difference(equal), level)
    worse = s.significant[line[0], line, layer] & s.significant[line, line[0], layer]
    standing = np.where(alike, "equal", np.where(worse, "worse", "open"))
    standing[0] = "first"

    def by_method(lines: np.ndarray, empty: object) -> np.ndarray:
        """From the order of the lines to that of the methods."""
        made = np.full((k, m), empty, dtype=object if isinstance(empty, str) else float)
        made[line[: len(lines)], layer] = lines
        return made

    return {
        "shapes": s.shapes,
        "versus_next": by_method(np.where(known, np.where(apart, "better", "open"), ""), ""),
        "detectable": by_method(np.where(known, found, np.nan), np.nan),
        "more_shapes": by_method(np.where(known[:1], more, np.nan), np.nan),
        "versus_first": by_method(np.where(there & rankable(s.shapes), standing, ""), ""),
    }
