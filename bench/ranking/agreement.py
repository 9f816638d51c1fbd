"""Whether two test sets order the methods alike: Kendall's tau of the two orders, and its uncertainty.

The orders are those of the means over all units (case, seed and sensor) planned for every method. Tau-b
(Kendall, "The Treatment of Ties in Ranking Problems", *Biometrika* 33, 1945) is the number of pairs of methods that
both sets order alike, minus those in opposite order, over the number of pairs; ties are excluded from that
number.

Two statements describe its uncertainty:

* ``low`` to ``high`` is a confidence interval. All pairs of methods are compared on each set by the paired relative
  differences that ranks are made of (:mod:`statistics`), with Holm's correction over all pairs of both sets; what
  follows from significant comparisons (a before b, b before c) is significant too. With the chosen level none of them
  is wrong, and tau of the true orders lies between its values if all other pairs disagree and if all agree. The
  interval is wide if methods are nearly equal, since many orders then fit the data; no valid one is narrow there.
* ``spread`` is the middle part of tau over resampled shapes (bootstrap of the clusters of both sets). It shows how tau
  varies with the choice of shapes, but is no confidence interval: two sets with the same true order rarely
  give a tau of 1, and resampling adds the same noise once more. In simulations it holds the true tau in nine cases of
  ten where the true orders are unrelated, but hardly ever where they are equal and methods are close
  (``tests/ranking/test_agreement.py``).

``halves`` is the median tau of many pairs of random halves of one set: orders from few shapes do not agree
better with another set than with themselves.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..errors import UsageError
from ..plugins.presets import resolve
from ..results.imputation import lent
from ..seeds import generator
from .leaderboard import leaderboard, unit_scores
from .order import metric_order
from .selection import CONTENDER, UNIT, Names, completed, matching, metrics_of, pool, select
from .statistics import SAME, holm, paired_differences

RESAMPLES = 2000
SPLITS = 200  # random halves
FEWEST_METHODS = 3
RANK = ("place", "rank_low", "rank_high", "mean", "ci_low", "ci_high", "solved", "planned")


@dataclass(frozen=True)
class Tau:
    """The agreement of the orders of two sets, on some of their units."""

    part: str  # "all", "sensor", or "family": what ``name`` names
    name: str
    without: bool  # whether the units are all except those of ``name``
    tau: float
    low: float  # the confidence interval
    high: float
    spread_low: float  # over resampled shapes
    spread_high: float
    agree: int  # pairs of methods that both sets significantly order alike
    reverse: int  # and the other way
    open: int  # and those that the shapes do not decide
    shapes: int  # of the first set
    shapes_other: int


@dataclass(frozen=True)
class Agreement:
    """The orders of one task on two sets, side by side."""

    task: str
    split: str
    metric: str
    better: str
    sides: tuple[str, str]
    families: tuple[str, ...]  # the datasets of the first side
    methods: pd.DataFrame  # CONTENDER, and the columns RANK with ``_1`` and ``_2`` behind them, in the first order
    taus: tuple[Tau, ...]  # of all, of each sensor, of each family alone, and without each family
    reversed: tuple[
        tuple[int, int], ...
    ]  # lines of ``methods``: the first set significantly prefers a, the second significantly b
    halves: tuple[float, float]
    left_out: int  # units not planned for all of the methods


@dataclass(frozen=True)
class Scores:
    """The scores of the methods on the units of one set; lower is better."""

    values: np.ndarray  # (units, k)
    starts: np.ndarray  # (n,) the first unit of each shape

    @property
    def means(self) -> np.ndarray:
        """(k,) array."""
        return self.values.mean(axis=0)

    @property
    def shapes(self) -> int:
        """How many shapes there are."""
        return len(self.starts)

    def resampled(self, weights: np.ndarray) -> np.ndarray:
        """(resamples, k): sums with each shape weighted by ``weights`` (resamples, n); their order is that of means."""
        return weights @ np.add.reduceat(self.values, self.starts, axis=0)


def agreement(
    rows: pd.DataFrame, other: Names, *, metric: Names = None, level: float = 0.95, **filters: Names
) -> list[Agreement]:
    """For each task (and split) of some results, the orders of the methods on two test sets.

    Parameters
    ----------
    rows : DataFrame
        One row per planned case.
    other : str or list of str
        The datasets of the second set (``real``); all others that pass the filters are the first one.
    metric : str, optional
        The first one is used; by default the one that ranks the task's tables.
    level : float
        Of the intervals.
    filters
        As of :func:`bench.ranking.selection.select`.

    Raises
    ------
    UsageError
        If a set is empty, or fewer than three methods were run on both.
    """
    rows = select(lent(completed(rows)), **filters)
    others = set(matching("agreement", other, rows["dataset"].unique()))
    if others == set(rows["dataset"]):
        raise UsageError(f"agreement {other}: there are no other datasets in these results to compare it with")
    second = rows["dataset"].isin(others)
    rows = pool(rows.assign(second=second, family=[*map(family_of, rows["dataset"], rows["case"])]), "task")
    found = [
        _of_table(part, tuple(key), metric, ("other" if len(others) > 1 else next(iter(others))), level)
        for key, part in rows.groupby(["task", "split"], sort=True)
    ]
    if not any(found):
        raise UsageError(
            f"agreement {other}: needs {FEWEST_METHODS} methods or more that were run, on the same cases, on both sides"
        )
    return [one for one in found if one]


def family_of(dataset: str, case: str) -> str:
    """The family of a shape: its dataset, or the part of a mixture that the id of the case begins with."""
    plugin = _plugin(dataset.partition("[")[0])
    return case.partition("-")[0] if plugin == "mixture" else dataset


@functools.cache
def _plugin(name: str) -> str:
    return resolve("dataset", name)


def _of_table(rows: pd.DataFrame, key: tuple[str, str], wanted: Names, other: str, level: float) -> Agreement | None:
    """One task and split; None if fewer than three methods have scores on both sides."""
    rows = _on_both(rows)
    metric = _head(rows, wanted) if len(rows) else ""
    if not metric:
        return None
    scores = unit_scores(rows, metric)
    complete = scores.planned.all(axis=1)
    cases = rows.drop_duplicates("case").set_index("case")
    family = scores.units["case"].map(cases["family"]).to_numpy()
    second = scores.units["case"].map(cases["second"]).to_numpy(dtype=bool)
    sensor = scores.units["condition"].to_numpy()
    sides = [complete & ~second, complete & second]
    k = scores.values.shape[1]
    if k < FEWEST_METHODS or not all(side.any() for side in sides):
        return None

    def taken(side: np.ndarray) -> Scores:
        codes = pd.factorize(scores.units["case"][side])[0]
        return Scores(scores.values[side], np.flatnonzero(np.r_[True, codes[1:] != codes[:-1]]))

    taus = []
    for (part, name, without), (a, b) in _parts(sides, family, sensor):
        rng = generator("agreement", *key, part, name, without)
        taus.append(compare(taken(a), taken(b), rng, level, part=part, name=name, without=without))
    both = [taken(side) for side in sides]
    order = np.lexsort([both[1].means, places(both[0].means)])
    significant = _significant(both, level)
    first = [(i, j) for i in order for j in order if significant[0][i, j] > 0 > significant[1][i, j]]
    line = {contender: number for number, contender in enumerate(order)}
    board = _boards(rows, scores.units[complete], metric, level)
    methods = scores.contenders.iloc[order].reset_index(drop=True)
    for n, side in enumerate(both, 1):
        methods[f"place_{n}"] = places(side.means)[order]
        lines = board[n - 1].set_index(CONTENDER)
        found = lines.loc[list(methods[CONTENDER].itertuples(index=False, name=None))]
        methods = methods.assign(**{f"{name}_{n}": found[name].to_numpy() for name in RANK[1:]})
    halves = [_halves(side, generator("agreement halves", *key, n)) for n, side in enumerate(both)]
    return Agreement(
        *key,
        metric,
        board[0]["better"].iloc[0],
        ("procedural" if other == "real" else "others", other),
        tuple(sorted(set(family[~second]))),
        methods,
        tuple(taus),
        tuple((line[i], line[j]) for i, j in first),
        (halves[0], halves[1]),
        int((~complete).sum()),
    )


def _on_both(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of the methods that were run on both sides."""
    sides = rows.groupby(CONTENDER, dropna=False)["second"].transform("nunique")
    return rows[sides == 2]


def _head(rows: pd.DataFrame, wanted: Names) -> str:
    """The metric that the methods are ordered by; empty if nothing was solved."""
    board = leaderboard(rows, by="task", metric=wanted)
    names = matching("metric", wanted, metrics_of(rows)) if wanted is not None else ()
    return next((name for name in metric_order(board.to_dict("records"), names) if name), "")


def _parts(
    sides: list[np.ndarray], family: np.ndarray, sensor: np.ndarray
) -> Iterator[tuple[tuple[str, str, bool], tuple[np.ndarray, np.ndarray]]]:
    """The parts on which orders are compared: everything, each sensor, each family of the first set, all but it."""
    first, second = sides
    yield ("all", "all", False), (first, second)
    sensors = sorted({str(name) for name in sensor})
    for name in sensors if len(sensors) > 1 else ():
        seen = sensor == name
        if (first & seen).any() and (second & seen).any():
            yield ("sensor", name, False), (first & seen, second & seen)
    families = sorted(set(family[first]))
    for name in families if len(families) > 1 else ():
        own = family == name
        yield ("family", name, False), (first & own, second)
        yield ("family", name, True), (first & ~own, second)


def _boards(rows: pd.DataFrame, units: pd.DataFrame, metric: str, level: float) -> list[pd.DataFrame]:
    """The leaderboards of the two sides over the same units."""
    kept = pd.MultiIndex.from_frame(rows[UNIT]).isin(list(units.itertuples(index=False, name=None)))
    # Already pooled: dataset and sensor are in the names of cases and in the condition.
    return [leaderboard(rows[kept & (rows["second"] == side)], metric=[metric], level=level) for side in (False, True)]


# -- tau ---------------------------------------------------------------------------------------------------------------


def compare(first: Scores, second: Scores, rng: np.random.Generator, level: float = 0.95, **about: Any) -> Tau:
    """Tau of two sets with its interval and its spread; ``about`` are the fields of :class:`Tau` that identify it."""
    a, b = places(first.means), places(second.means)
    significant = _significant((first, second), level)
    pairs = np.triu_indices(len(a), 1)
    product = (significant[0] * significant[1])[pairs]
    agree, reverse = int((product > 0).sum()), int((product < 0).sum())
    n, unclear = len(product), int((product == 0).sum())
    spread_low, spread_high = _spread(first, second, rng, level)
    return Tau(
        **about,
        tau=float(tau_b(a, b)),
        low=(agree - reverse - unclear) / n,
        high=(agree - reverse + unclear) / n,
        spread_low=spread_low,
        spread_high=spread_high,
        agree=agree,
        reverse=reverse,
        open=unclear,
        shapes=first.shapes,
        shapes_other=second.shapes,
    )


def places(means: np.ndarray) -> np.ndarray:
    """The place of each method, 1 for the smallest mean; means that differ only by rounding share the better one."""
    order = np.argsort(means, kind="stable")
    ordered = means[order]
    later = np.r_[True, np.diff(ordered) > SAME * (abs(ordered[1:]) + abs(ordered[:-1]))]
    found = np.empty(len(means), dtype=int)
    found[order] = np.maximum.accumulate(np.where(later, np.arange(1, len(means) + 1), 0))
    return found


def tau_b(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Kendall's tau-b of the last axis, for many pairs of orders at once.

    Parameters
    ----------
    a, b : (..., k) arrays
        Scores; differences below the rounding are ties.

    Returns
    -------
    (...) array
        NaN if all of one side are tied.
    """
    i, j = np.triu_indices(a.shape[-1], 1)

    def signs(x: np.ndarray) -> np.ndarray:
        difference = x[..., i] - x[..., j]
        return np.where(abs(difference) > SAME * (abs(x[..., i]) + abs(x[..., j])), np.sign(difference), 0.0)

    s, t = signs(a), signs(b)
    with np.errstate(invalid="ignore", divide="ignore"):
        return (s * t).sum(axis=-1) / np.sqrt((s**2).sum(axis=-1) * (t**2).sum(axis=-1))


def _spread(first: Scores, second: Scores, rng: np.random.Generator, level: float) -> tuple[float, float]:
    """The central ``level`` part of tau over resampled shapes; NaN if one set has a single shape."""
    if min(first.shapes, second.shapes) < 2:
        return float("nan"), float("nan")
    a, b = (
        side.resampled(rng.multinomial(side.shapes, np.full(side.shapes, 1 / side.shapes), size=RESAMPLES))
        for side in (first, second)
    )
    taus = tau_b(a, b)
    return _quantile(taus, (1 - level) / 2), _quantile(taus, (1 + level) / 2)


def _halves(side: Scores, rng: np.random.Generator) -> float:
    """The median tau of two random halves of a set; NaN with fewer than four shapes."""
    if side.shapes < 4:
        return float("nan")
    chosen = np.argsort(rng.random((SPLITS, side.shapes)), axis=1) < side.shapes // 2
    halves = [side.resampled(weights.astype(float)) for weights in (chosen, ~chosen)]
    return _quantile(tau_b(*halves), 0.5)


def _quantile(taus: np.ndarray, at: float) -> float:
    """Of those that are defined; NaN, without a warning, if none is: methods that score alike have no order."""
    known = taus[np.isfinite(taus)]
    return float(np.quantile(known, at)) if len(known) else float("nan")


def _significant(sides: tuple[Scores, Scores] | list[Scores], level: float) -> list[np.ndarray]:
    """For each set a (k, k) array: 1 where the first method is significantly better, -1 where the second is, else 0.

    With probability ``level`` or more, neither array is wrong.
    """
    tests = [
        paired_differences(s.values[..., None], np.ones((*s.values.shape, 1), dtype=bool), s.starts) for s in sides
    ]
    k = sides[0].values.shape[1]
    i, j = np.triu_indices(k, 1)
    p = np.concatenate([p[i, j, 0] for _, p in tests])
    rejected = holm(p[None], 1 - level)[0].reshape(2, -1)
    found = []
    for (difference, _), significantly in zip(tests, rejected, strict=True):
        before = np.zeros((k, k), dtype=bool)
        before[i, j], before[j, i] = (
            significantly & (difference[i, j, 0] < 0),
            significantly & (difference[i, j, 0] > 0),
        )
        for middle in range(k):  # a before b and b before c: a before c
            before |= before[:, middle, None] & before[None, middle]
        found.append(before.astype(int) - before.T)
    return found


def as_records(found: list[Agreement]) -> Iterator[Mapping[str, object]]:
    """Everything as lines of one table: those of the methods, then those of tau, for each task."""
    for one in found:
        head = {"task": one.task, "split": one.split, "metric": one.metric, "first": one.sides[0]}
        head |= {"second": one.sides[1]}
        for line in one.methods.to_dict("records"):
            yield {"line": "method", **head, **line}
        for tau in one.taus:
            yield {"line": "tau", **head, **vars(tau)}
