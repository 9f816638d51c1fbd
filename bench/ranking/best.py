"""The best parameters of a method: the variants of a sweep by geometric means, and the effect of each parameter.

The score of a variant is the geometric mean of a metric over all cases, so that each case counts by ratio, whatever
its scale: 10 % on an easy shape is as much as 10 % on a hard one. Variants are compared with the winner by the ratio of
these means, with Student's interval over the shapes in the logarithm. The effect of a parameter is the same score for
each of its values, over all variants with that value; if the sweep is not a full grid, only over those settings of the
other parameters that were run with every value.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..errors import UsageError
from ..results.imputation import lent
from .leaderboard import unit_values
from .naming import parts_of
from .order import metric_order
from .published import all_parameters
from .resolution import FEWEST
from .selection import GROUP, UNIT, Names, completed, matching, metrics_of, pool, select
from .statistics import student_quantile

LEAST = 1e-9  # smaller values count as this, for the logarithm
TRAIN = "train"


@dataclass(frozen=True)
class Variant:
    """One setting of the parameters."""

    variant: str  # as rows have it; empty for the defaults
    parameters: Mapping[str, str]  # all parameters that the sweep varied
    mean: float  # geometric, in the metric's unit
    ratio: float  # to the winner's mean
    low: float  # its interval; NaN with too few shapes
    high: float
    solved: int
    planned: int
    seconds: float  # median of the solved cases

    @property
    def is_tied(self) -> bool:
        """Whether the interval of the ratio contains 1: not significantly worse than the winner."""
        return self.low <= 1 <= self.high


@dataclass(frozen=True)
class Effect:
    """The effect of one value of a parameter."""

    parameter: str
    value: str
    mean: float  # geometric, over all compared variants
    ratio: float  # to the best value
    variants: int  # their number


@dataclass(frozen=True)
class Best:
    """The variants of one method on the cases of one table, the best first."""

    group: tuple[str, str, str, str]
    method: str
    metric: str
    better: str
    shapes: int
    level: float
    variants: tuple[Variant, ...]
    effects: tuple[Effect, ...]
    edges: tuple[str, ...]  # a sentence for each parameter of the winner that lies at the edge of the grid
    notes: tuple[str, ...]


def best(
    rows: pd.DataFrame, *, by: Names = "task", metric: Names = None, level: float = 0.95, **filters: Names
) -> list[Best]:
    """The variants of each method that was run with several settings.

    Parameters
    ----------
    rows : DataFrame
        One row per planned case.
    by : str or list of str
        What is compared separately, see :func:`bench.ranking.selection.pool`; by default only the tasks.
    metric : str, optional
        The first one is used; by default the one that ranks the methods of a task.
    level : float
        Of the intervals.
    filters
        See :func:`bench.ranking.selection.select`. Without ``split`` only train shapes are used.

    Raises
    ------
    UsageError
        If there is nothing to compare, with advice.
    """
    rows = completed(rows)
    if not filters.get("split"):
        if not (rows["split"] == TRAIN).any():
            raise UsageError(
                "--best: parameters are chosen on train shapes, and these results have none. Run the sweep with "
                "split=train; --split test chooses on the test shapes anyway, which flatters the winner"
            )
        filters["split"] = TRAIN
    chosen = pool(select(lent(rows), **filters), by)
    found = []
    for group, part in chosen.groupby(GROUP, sort=True):
        variants = part.groupby("method")["variant"].nunique()
        for method in variants[variants > 1].index:
            found.append(_best(group, method, part[part["method"] == method], metric, level))
    if not found:
        raise UsageError(
            "--best: no method was run with several settings here. A sweep has them: "
            "detailbench run -m split=train method=poisson method.depth=7,8,9"
        )
    return found


def _best(group: tuple, method: str, rows: pd.DataFrame, metric: Names, level: float) -> Best:
    name, better = _metric_of(group[0], rows, metric)
    units = unit_values(rows, name)
    units = units.assign(unit=list(zip(*(units[column] for column in UNIT), strict=True)))
    logs = units.assign(log=np.log(units["value"].clip(lower=LEAST))).groupby(["unit", "variant"], sort=False)
    table = logs["log"].agg(lambda values: values.mean(skipna=False)).unstack("variant")
    ran = logs.size().unstack("variant").notna()
    whole = ran.sum().max()
    alike: dict[bytes, list[str]] = {}
    for variant in table.columns:
        if ran[variant].sum() == whole:
            alike.setdefault(ran[variant].to_numpy().tobytes(), []).append(variant)
    kept = max(alike.values(), key=len)  # of several sets of as many cases, that of most variants
    table = table.loc[ran[kept[0]], kept]
    silent = ~table.notna().any(axis=1)  # as where the case itself could not be made: it is no setting's failure
    table = table if silent.all() else table[~silent]
    sign = -1 if better == "higher" else 1
    means = (sign * table.mean(skipna=False)).fillna(math.inf)
    order = sorted(kept, key=lambda variant: (means[variant], variant))
    cases = [unit[0] for unit in table.index]
    shapes = table.groupby(cases, sort=False).agg(lambda values: values.mean(skipna=False))
    settings = _settings(method, order)
    costs = rows[rows["status"] == "ok"].groupby("variant")["seconds"].median()
    counts = units.groupby("variant")[["solved", "planned"]].sum()
    variants = [
        Variant(
            variant,
            settings[variant],
            _exp(table[variant].mean(skipna=False)),
            *_ratio((shapes[variant] - shapes[order[0]]).to_numpy(), level),
            int(counts["solved"][variant]),
            int(counts["planned"][variant]),
            float(costs.get(variant, math.nan)),
        )
        for variant in order
    ]
    dropped = [f"{v or 'the defaults'} ({ran[v].sum()} of {whole})" for v in ran.columns if v not in kept]
    notes = [f"Left out, run on fewer or other cases: {'; '.join(dropped)}."] if dropped else []
    if silent.any():
        notes.append(f"Left out, failed with every setting at unknown cost: {silent.sum()} of {whole} cases and seeds.")
    return Best(
        group=group,
        method=method,
        metric=name,
        better=better,
        shapes=len(shapes),
        level=level,
        variants=tuple(variants),
        effects=tuple(_effects(variants, sign)),
        edges=tuple(_edges(variants)) if math.isfinite(variants[0].mean) else (),
        notes=tuple(notes),
    )


def _metric_of(task: str, rows: pd.DataFrame, metric: Names) -> tuple[str, str]:
    """The deciding metric, and its direction.

    Raises
    ------
    UsageError
        If nothing was solved, or the metric is not a distance or share.
    """
    names = metrics_of(rows)
    lines = []
    for name in matching("metric", metric, names) if metric else names:
        units = unit_values(rows, name)
        if units["solved"].any():
            floor = rows[f"floor.{name}"].mean() if f"floor.{name}" in rows else math.nan
            lines.append({"task": task, "metric": name, "better": units["better"].iloc[0], "floor": floor})
    if not lines:
        raise UsageError("--best: nothing was solved, so no parameters are better than others")
    first = metric_order(lines)[0] if not metric else lines[0]["metric"]
    better = next(line["better"] for line in lines if line["metric"] == first)
    if better == "reference":
        raise UsageError(f"--best: {first} is best near the reference's own value, and has no geometric mean")
    return first, better


def _exp(value: float) -> float:
    return math.exp(value) if math.isfinite(value) else math.nan


def _ratio(differences: np.ndarray, level: float) -> tuple[float, float, float]:
    """exp of the mean of differences of logarithms, one a shape, with Student's interval."""
    n, mean = len(differences), float(np.mean(differences))
    if n < FEWEST or not math.isfinite(mean):
        return _exp(mean), math.nan, math.nan
    reach = float(student_quantile((1 + level) / 2, np.array(n - 1.0))) * float(differences.std(ddof=1)) / math.sqrt(n)
    return math.exp(mean), math.exp(mean - reach), math.exp(mean + reach)


def _settings(method: str, variants: Sequence[str]) -> dict[str, dict[str, str]]:
    """Of each variant the parameters that differ between any two, in words."""
    given = {variant: dict(part.partition("=")[::2] for part in parts_of(variant)) for variant in variants}
    usual = all_parameters(method, "")
    names = list(dict.fromkeys(name for values in given.values() for name in values))
    whole = {v: {name: values.get(name, usual.get(name, "default")) for name in names} for v, values in given.items()}
    varied = [name for name in names if len({values[name] for values in whole.values()}) > 1]
    return {v: {name: values[name] for name in varied} for v, values in whole.items()}


def _effects(variants: Sequence[Variant], sign: int) -> list[Effect]:
    found = []
    for name in variants[0].parameters:
        values = list(dict.fromkeys(v.parameters[name] for v in variants))
        rest = {v.variant: tuple(x for key, x in v.parameters.items() if key != name) for v in variants}
        ran: dict[tuple, set[str]] = {}
        for v in variants:
            ran.setdefault(rest[v.variant], set()).add(v.parameters[name])
        balanced = {others for others, had in ran.items() if len(had) == len(values)}
        means = {}
        for value in values:
            own = [v.mean for v in variants if v.parameters[name] == value]
            even = [v.mean for v in variants if v.parameters[name] == value and rest[v.variant] in balanced]
            means[value] = (_geometric(even or own), len(even or own))
        first = min((sign * mean for mean, _ in means.values() if math.isfinite(mean)), default=math.nan)
        for value in sorted(values, key=_sorting):
            mean, count = means[value]
            found.append(Effect(name, value, mean, mean / (sign * first), count))
    return found


def _geometric(values: Iterable[float]) -> float:
    return _exp(float(np.mean(np.log(list(values)))))


def _edges(variants: Sequence[Variant]) -> list[str]:
    """The parameters whose winner is the least or largest tried value, and what to try next."""
    found = []
    for name, value in variants[0].parameters.items():
        numbers = sorted({n for v in variants if (n := _number(v.parameters[name])) is not None})
        mine = _number(value)
        if mine is None or len(numbers) < 2 or mine not in (numbers[0], numbers[-1]):
            continue
        side, more = ("largest", numbers[::-1]) if mine == numbers[-1] else ("least", numbers)
        following = _beyond(more)
        advice = f"; try method.{name}={following}" if float(following) != mine else ""
        found.append(f"{name}={value} is the {side} value of the sweep: the best may lie beyond it{advice}.")
    return found


def _beyond(numbers: Sequence[float]) -> str:
    """The next number of a series that starts with the last two tried; of whole positive ones at least 1."""
    last, before = numbers[:2]
    following = last + (last - before)
    if last > 0 >= following or (0 not in numbers and _is_geometric(numbers)):
        following = last * last / before
    if not all(number.is_integer() for number in numbers):
        return f"{following:g}"
    return str(max(round(following), 1) if last > 0 else round(following))


def _is_geometric(numbers: Sequence[float]) -> bool:
    """Whether the ratios of neighbours are more alike than their differences: also 1, 3, 10, 30; not of two numbers."""
    pairs = list(itertools.pairwise(numbers))
    return _variation([b / a for a, b in pairs]) < _variation([b - a for a, b in pairs])


def _variation(values: Sequence[float]) -> float:
    return (max(values) - min(values)) / max(map(abs, values))


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _sorting(text: str) -> tuple:
    number = _number(text)
    return (number is None, number or 0.0, text)
