"""Two sets of results, then and now: what got significantly worse, new, gone, failed or slower.

Units (shape, seed and sensor) are paired by all keys of a row except its machine. For each method and metric, the mean
paired relative difference is tested against a threshold by a one-sided test of Student's t over shapes, and Holm's
correction runs over all methods and metrics: however many there are, the chance of any false alarm is 1 - level.

The relative difference is ``2 (now - then) / (|now| + |then|)``, of badness (lower is better), which is robust
for scores near 0; it is shown as the equivalent ratio: ``(2 + s) / (2 - s) - 1``.

Speed is the ratio of the processor seconds of calls with one thread, and of the wall seconds of others, each divided by
the time of a fixed workload measured just before the call (:mod:`bench.engine.yardstick`): this cancels the speed of
the machine, as far as it affects both alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..errors import UsageError
from ..results.imputation import lent
from .leaderboard import unit_scores
from .selection import Names, completed, metrics_of, pool, select
from .statistics import SAME, beyond, holm

METHOD = ["method", "variant", "threads", "device"]
KEY = ["task", "dataset", "sensor", "split", *METHOD, "seed", "case"]
SIDES = ("then", "now")
SHORTEST = 0.05  # seconds: shorter calls say little about a method: the clock and the system dominate them
SEEN = 0.1  # of the wall time: with less processor time the work is done elsewhere
SLOWER = 0.2  # the default threshold of ``slower``


@dataclass(frozen=True)
class Compared:
    """The comparison of two sets of results.

    Attributes
    ----------
    quality : DataFrame
        One line per task, split, method and metric: ``shapes``, ``units``, ``then``, ``now`` (means over the units that
        both solved), ``change`` (0.05: 5 % worse; negative: better) with ``low`` and ``high`` (NaN for one shape and
        seed), ``verdict`` (``worse`` and ``better`` significantly, by more than the threshold; ``same`` within it;
        ``open``).
    speed : DataFrame
        One line per task, split and method: ``time`` (``processor`` or ``wall``), ``then``, ``now`` (median seconds),
        ``ratio`` (the median of the paired ratios) with ``low`` and ``high``, ``normalised``, ``verdict`` (``slower``,
        ``faster``, ``same``, ``open``, ``short``).
    new, gone : DataFrame
        How many cases only one side has, by :data:`METHOD`, task, dataset and sensor.
    failed, solved : DataFrame
        Pairs that failed now and were solved then, and the reverse.
    changed : tuple
        The records whose fingerprints differ: cell and fingerprint then, cell and fingerprint now.
    """

    quality: pd.DataFrame
    speed: pd.DataFrame
    new: pd.DataFrame
    gone: pd.DataFrame
    failed: pd.DataFrame
    solved: pd.DataFrame
    pairs: int
    worse: float
    slower: float
    level: float
    notes: tuple[str, ...] = ()
    changed: tuple[tuple[str, str, str, str], ...] = ()


def compared(
    then: pd.DataFrame,
    now: pd.DataFrame,
    *,
    metric: Names = None,
    worse: float = 0.02,
    slower: float | None = None,
    level: float = 0.95,
    **filters: Names,
) -> Compared:
    """Compare two sets of rows.

    Parameters
    ----------
    then, now : DataFrame
        As returned by :meth:`bench.results.store.Results.rows`.
    metric : str or list of str, optional
        Metric keys; by default all that both sides have.
    worse, slower : float
        Thresholds: 0.02 is 2 %. If ``slower`` is None, :data:`SLOWER` is used.
    level : float
        Of intervals, and of the tests together.
    **filters
        Of :func:`bench.ranking.selection.select`.

    Raises
    ------
    UsageError
        If the two have no case in common, or for a filter that matches nothing on either side.
    """
    sides = [_latest(_chosen(rows, filters)) for rows in (then, now)]
    keys = [pd.MultiIndex.from_frame(rows[KEY]) for rows in sides]
    both = keys[0].intersection(keys[1])
    if not len(both):
        raise UsageError(
            "the two results have no case in common: compare runs of the same datasets, sensors, seeds and methods "
            "(detailbench leaderboard DIR shows what is in each)"
        )
    a, b = (rows[key.isin(both)].assign(host=side) for rows, key, side in zip(sides, keys, SIDES, strict=True))
    rows = pd.concat([a, b], ignore_index=True)
    slower = SLOWER if slower is None else slower
    merged = a.merge(b, on=KEY, suffixes=("_then", "_now"))
    lost, won = (
        merged[(merged[f"status_{one}"] == "ok") & (merged[f"status_{other}"] != "ok")]
        for one, other in (SIDES, SIDES[::-1])
    )
    quality = _quality(rows, _metrics(sides, metric), worse, level)
    speed = _speed(merged, slower, level)
    return Compared(
        quality,
        speed,
        new=_counted(sides[1][~keys[1].isin(both)]),
        gone=_counted(sides[0][~keys[0].isin(both)]),
        failed=lost.reset_index(drop=True),
        solved=won.reset_index(drop=True),
        pairs=len(both),
        worse=worse,
        slower=slower,
        level=level,
        notes=_notes(quality, speed),
        changed=_changed(merged),
    )


def _chosen(rows: pd.DataFrame, filters: dict[str, Names]) -> pd.DataFrame:
    """The rows that pass the filters, each with the cost of its failure."""
    rows = select(lent(completed(rows)), **filters)
    missing = {name: np.nan for name in ("reference_seconds",) if name not in rows}
    return rows.assign(**missing, variant=rows["variant"].fillna(""))


def _latest(rows: pd.DataFrame) -> pd.DataFrame:
    """One row for each key: several machines may have run one case."""
    ordered = rows.sort_values("finished", kind="stable") if "finished" in rows else rows
    return ordered.drop_duplicates(KEY, keep="last").sort_index()


def _metrics(sides: list[pd.DataFrame], metric: Names) -> list[str]:
    common = sorted(set.intersection(*(set(metrics_of(rows)) for rows in sides)))
    if metric is None:
        return common
    for rows in sides:
        metrics_of(rows, metric)  # an unknown name is refused, with the nearest one
    return [m for m in metrics_of(sides[1], metric) if m in common]


def _changed(merged: pd.DataFrame) -> tuple[tuple[str, str, str, str], ...]:
    names = [f"{name}_{side}" for side in SIDES for name in ("cell", "fingerprint")]
    other = merged[(merged["fingerprint_then"] != merged["fingerprint_now"]).to_numpy()]
    return tuple(other[names].drop_duplicates().itertuples(index=False, name=None))


def _counted(rows: pd.DataFrame) -> pd.DataFrame:
    by = [*METHOD, "task", "dataset", "sensor"]
    return rows.groupby(by, dropna=False).size().rename("cases").reset_index()


# -- quality -----------------------------------------------------------------------------------------------------------


def _quality(rows: pd.DataFrame, metrics: list[str], worse: float, level: float) -> pd.DataFrame:
    lines = []
    pooled = pool(rows, "task")
    for (task, split), table in pooled.groupby(["task", "split"], sort=True):
        for name in metrics:
            lines += [{"task": task, "split": split, "metric": name} | line for line in _of_metric(table, name, level)]
    columns = ["task", "split", *METHOD, "metric", "shapes", "units", "then", "now", "change", "low", "high", "verdict"]
    if not lines:
        return pd.DataFrame(columns=columns)
    bound = 2 * worse / (2 + worse)
    sums, counts = (_stacked([line.pop(name) for line in lines]) for name in ("sums", "counts"))
    mean, low, high, p = beyond(sums, counts, bound, level)
    p_better = beyond(-sums, counts, bound, level)[3]
    verdicts = _verdicts((mean, low, high), (p, p_better), bound, level, ("worse", "better"))
    shown = (_as_ratio(array) for array in (mean, low, high))
    found = pd.DataFrame(lines).assign(**dict(zip(("change", "low", "high"), shown, strict=True)), verdict=verdicts)
    return found[columns]


def _of_metric(table: pd.DataFrame, metric: str, level: float) -> list[dict]:
    """The lines of one metric: for each method the sums and counts of relative differences, per shape."""
    scores = unit_scores(table, metric)
    sides: dict[str, dict[tuple[Any, ...], int]] = {side: {} for side in SIDES}
    for place, line in enumerate(scores.contenders.to_dict("records")):
        if line["host"] in sides:
            sides[line["host"]][tuple(line[name] for name in METHOD)] = place
    means = _means(table, metric)
    cases = scores.units["case"]
    lines = []
    for method in sorted(sides["then"].keys() & sides["now"].keys(), key=str):
        a, b = (sides[side][method] for side in SIDES)
        units = scores.planned[:, a] & scores.planned[:, b]
        if not units.any():
            continue
        difference = _relative(scores.values[units, a], scores.values[units, b])
        shapes = cases[units].nunique()
        # With a single shape only the seeds vary: the interval is then about this shape.
        clusters = cases[units] if shapes > 1 else scores.units["seed"][units]
        grouped = pd.Series(difference).groupby(clusters.to_numpy())
        lines.append(
            dict(zip(METHOD, method, strict=True))
            | {"shapes": shapes, "units": int(units.sum()), "sums": grouped.sum(), "counts": grouped.size()}
            | dict(zip(SIDES, means.get(method, (math.nan, math.nan)), strict=True))
        )
    return lines


def _means(table: pd.DataFrame, metric: str) -> dict[tuple, tuple[float, float]]:
    """For each method the mean scores then and now, over the units that both solved."""
    name = f"score.{metric}"
    unit = ["case", "seed", "condition"]
    a, b = (table[(table["host"] == side) & (table["status"] == "ok")] for side in SIDES)
    merged = a[[*METHOD, *unit, name]].merge(b[[*METHOD, *unit, name]], on=[*METHOD, *unit], suffixes=SIDES)
    merged = merged.dropna(subset=[name + side for side in SIDES])
    means = merged.groupby(METHOD, dropna=False)[[name + side for side in SIDES]].mean()
    return {key: tuple(values) for key, values in zip(means.index, means.to_numpy(), strict=True)}


def _relative(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """``2 (b - a) / (|a| + |b|)``; 0 if the two are equal up to rounding."""
    size = abs(a) + abs(b)
    differs = abs(b - a) > SAME * size
    return np.divide(2 * (b - a), size, out=np.zeros(len(a)), where=differs)


def _as_ratio(relative: np.ndarray) -> np.ndarray:
    """The ratio for a symmetric relative difference: 0.05 for 5 % more."""
    within = np.clip(relative, -2, 2)  # the end of an interval may lie outside
    with np.errstate(divide="ignore"):
        return (2 + within) / (2 - within) - 1


def _stacked(parts: list[pd.Series]) -> np.ndarray:
    """(clusters, lines): one column for each line, 0 where it has fewer clusters than another."""
    full = np.zeros((max(map(len, parts)), len(parts)))
    for place, part in enumerate(parts):
        full[: len(part), place] = part.to_numpy(dtype=float)
    return full


def _verdicts(
    interval: tuple[np.ndarray, np.ndarray, np.ndarray],
    p: tuple[np.ndarray, np.ndarray],
    bound: float,
    level: float,
    words: tuple[str, str],
) -> list[str]:
    """Significantly above or below the threshold, by Holm over all lines, ``same`` within it, or ``open``."""
    mean, low, high = interval
    # Lines in which no pair differs cannot raise a false alarm, so they are not among the hypotheses.
    equal = (abs(mean) <= SAME) & ~(high - low > SAME)
    above, below = (holm(values[None, :], 1 - level, int((~equal).sum()))[0] for values in p)
    within = ((low > -bound) & (high < bound)) | equal
    return [
        words[0] if more else words[1] if less else "same" if same else "open"
        for more, less, same in zip(above, below, within, strict=True)
    ]


# -- speed -------------------------------------------------------------------------------------------------------------


def _speed(merged: pd.DataFrame, slower: float, level: float) -> pd.DataFrame:
    """The ratios of the seconds on units that both solved, by method."""
    columns = ["task", "split", *METHOD, "time", "units", "then", "now", "ratio", "low", "high"]
    columns += ["normalised", "verdict"]
    solved = merged[(merged["status_then"] == "ok") & (merged["status_now"] == "ok")]
    solved = solved[(solved["seconds_then"] > 0) & (solved["seconds_now"] > 0)]
    lines = []
    for key, rows in solved.groupby(["task", "split", *METHOD], dropna=False, sort=True):
        measure, name = _measure(rows)
        before, after = (rows[f"{measure}_{side}"].to_numpy(dtype=float) for side in SIDES)
        ratio = after / before
        machine = (rows["reference_seconds_now"] / rows["reference_seconds_then"]).to_numpy(dtype=float)
        line = dict(zip(["task", "split", *METHOD], key, strict=True))
        # The workload runs on processors: it does not measure a GPU.
        normalised = bool(np.isfinite(machine).all() and (machine > 0).all()) and line["device"] == "cpu"
        ratio = ratio / machine if normalised else ratio
        grouped = pd.Series(np.log(ratio)).groupby((rows["dataset"] + "/" + rows["case"]).to_numpy())
        line |= {"time": name, "units": len(rows), "then": np.median(before), "now": np.median(after)}
        line |= {"ratio": float(np.median(ratio)), "normalised": normalised}
        lines.append(line | {"sums": grouped.sum(), "counts": grouped.size()})
    if not lines:
        return pd.DataFrame(columns=columns)
    sums, counts = (_stacked([line.pop(name) for line in lines]) for name in ("sums", "counts"))
    bound = math.log1p(slower)
    mean, low, high, p = beyond(sums, counts, bound, level)
    p_faster = beyond(-sums, counts, bound, level)[3]
    verdicts = _verdicts((mean, low, high), (p, p_faster), bound, level, ("slower", "faster"))
    found = pd.DataFrame(lines).assign(low=np.exp(low), high=np.exp(high))
    short = np.maximum(found["then"], found["now"]) < SHORTEST
    # The median must agree: a mean of logarithms may come from one call that had to wait.
    doubtful = (np.array(verdicts) == "slower") & (found["ratio"] <= 1 + slower)
    verdict = np.where(short, "short", np.where(doubtful, "open", verdicts))
    return found.assign(verdict=verdict)[columns]


def _measure(rows: pd.DataFrame) -> tuple[str, str]:
    """The time by which paired calls are compared: the column, and its name.

    With one thread the processor time, which other load does not lengthen; a program in a container takes
    none that we see, and is measured by the wall clock like several threads and GPUs.
    """
    one = bool((rows["threads"] == 1).all() and (rows["device"] == "cpu").all())
    columns = [f"cpu_seconds_{side}" for side in SIDES]
    shares = [rows[column] / rows[f"seconds_{side}"] for column, side in zip(columns, SIDES, strict=True)]
    seen = all((share > SEEN).all() for share in shares)
    return ("cpu_seconds", "processor") if one and seen else ("seconds", "wall")


def _notes(quality: pd.DataFrame, speed: pd.DataFrame) -> tuple[str, ...]:
    notes = []
    few = int((quality["shapes"] < 4).sum())
    if few:
        notes.append(
            f"{few} of {len(quality)} lines of quality have fewer than four shapes: only a large loss is significant."
        )
    unnormalised = speed[~speed["normalised"].astype(bool)]
    if len(unnormalised):
        names = ", ".join(sorted(set(unnormalised["method"])))
        notes.append(
            f"Not normalised by the speed of the machine: {names}. The rows have no reference_seconds (results of an "
            "earlier version), or are of a GPU. Compare runs of one machine."
        )
    return tuple(notes)
