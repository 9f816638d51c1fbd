"""From rows, one per planned case, to a leaderboard: which method is better, by how much, how certainly, at what cost.

::

    board = leaderboard(rows, task="reconstruct", metric="chamfer_l1_mean,p2f_mean")
    print(render(board, "terminal", rows=rows))

Its rules for a fair comparison:

* Failing never pays. A failed case enters the mean and the rank with the score of the worst pseudo-method on it
  (:mod:`imputation`), and solved/planned is shown beside the mean. If that score is not known, the mean leaves the
  case out, and for the rank it is worse than any answer. A method that solved nothing has no rank and comes last. A
  score that is NaN or infinite is a failure of that metric.
* A method does not benefit from a case on which it was not run: two methods are compared on the units (case and seed)
  planned for both.
* A method that was given true distances of the reference reports it in ``true_distances``, and is marked in print.
* Intervals and ranks are over shapes: the seeds of one shape, and its sensors if a table has
  several, share its difficulty and count as one cluster; see :mod:`bench.ranking.statistics`.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..errors import UsageError
from ..results.imputation import PREFIX, lent
from .fronts import COSTS, criteria_of, front
from .places import places
from .resolution import EQUAL, Standings, check_region, rankable, resolve
from .selection import CONTENDER, GROUP, UNIT, Names, completed, metrics_of, pool, prepared, select
from .statistics import mean_intervals, ranks_of, significant_differences

COLUMNS = (
    "task",
    "dataset",
    "sensor",
    "split",
    "method",
    "variant",
    "threads",
    "device",
    "host",
    "metric",
    "better",  # lower, higher or reference (nearest to `floor`, the reference's own value)
    "mean",  # in the metric's unit, as the next three; of a reference metric, that of the absolute difference
    "ci_low",
    "ci_high",
    "floor",  # over solved cases
    "rank_low",  # the interval of the rank; missing if nothing was solved, like the mean
    "rank_high",
    "solved",  # of the `planned` cases, these enter the mean with their scores
    "planned",
    "imputed",  # and these, which failed, with the score of the worst pseudo-method
    "seconds_median",  # over solved cases, as the next two
    "peak_rss_mb",  # the largest
    "train_seconds",  # of the training of a learned method, the median of several; missing if unknown
    "true_distances",  # number of points with true distances given to the method, the maximum over cases
    # The resolution of a table, see resolution.py and fronts.py. Comparisons are empty with fewer than four shapes,
    # which are too few to rank by: ranks are then those of a tie.
    "front",  # 1 on the Pareto front of two criteria, else empty
    "shapes",  # number of shapes planned for the method
    "not_run",  # number of units (case and seed) of the table on which the method was not run
    "undefined",  # number of units for which the metric is undefined for this output but not for another's
    "score_mean",  # of a reference metric: the mean of the score itself, as `mean` is over solved and imputed units
    "versus_next",  # against the next line: better (significantly) or open
    "detectable",  # the relative difference to the next line found with 80 % power; 0.1: one is 1.1 times the other
    "more_shapes",  # first line: how many more shapes separate the first two; infinite above 1,000, empty: none would
    "versus_first",  # first, equal (significantly less apart than `equal`), worse (significantly) or open
    "place",  # best (mean), tied (not significantly worse than the best), second (best mean); empty for all others
)
FAR = 1e6  # times the largest score: the value of a failure in the ranks if its score is not known

_GROUP = slice(len(GROUP))  # their columns among the codes of a cell
_UNIT = slice(_GROUP.stop, _GROUP.stop + len(UNIT))
_CASE = slice(_UNIT.start, _UNIT.start + 1)
_SEEDED = slice(_UNIT.start, _UNIT.start + 2)
_CONTENDER = slice(_UNIT.stop, _UNIT.stop + len(CONTENDER))

_Part = dict[str, np.ndarray]  # columns of a board, with "row": the cell that has the names, "metric": which one


# -- the board ---------------------------------------------------------------------------------------------------------


def leaderboard(
    rows: pd.DataFrame,
    *,
    task: Names = None,
    dataset: Names = None,
    metric: Names = None,
    sensor: Names = None,
    method: Names = None,
    tag: Names = None,
    split: Names = None,
    by: Names = None,
    pareto: Names = None,
    level: float = 0.95,
    equal: float = EQUAL,
) -> pd.DataFrame:
    """One row per task, dataset, sensor, split, metric and method (with its variant), best first.

    Train and test shapes are never in one table, and results of two devices, or of two numbers of threads, never in one
    line; nor are those of two machines that ran the same cases.

    Parameters
    ----------
    rows : DataFrame
        One row per planned case.
    task, dataset, sensor, method, tag, split
        Filters, see :func:`select`. Ranks are among the selected methods.
    metric : str or list of str
        Metric keys; ``fscore`` stands for every ``fscore@...``.
    by : str or list of str, optional
        Keys of the tables besides the task, see :func:`selection.pool`; by dataset and sensor without it.
    pareto : str or list of str, optional
        The two criteria of ``front``, see :func:`bench.ranking.fronts.front`; on the board even if not in ``metric``.
    level, equal : float
        Confidence level of intervals and ranks; relative difference below which two methods are equal in practice.

    Returns
    -------
    DataFrame
        With the columns explained at :data:`COLUMNS`. A group in which nothing was solved and no metric is known has
        one line per method with an empty ``metric``.

    Raises
    ------
    UsageError
        For filters that match nothing, or another invalid argument.
    """
    if not 0 < level < 1:
        raise UsageError(f"level: expected a number between 0 and 1, got {level}")
    check_region(equal)
    rows = lent(completed(rows))
    rows = select(rows, task=task, dataset=dataset, sensor=sensor, method=method, tag=tag, split=split)
    rows = pool(rows, by)
    if not len(rows):
        return pd.DataFrame(columns=list(COLUMNS))
    criteria = criteria_of(pareto, metrics_of(rows))
    board = _board(rows, sorted({*metrics_of(rows, metric), *criteria} - {*COSTS}), level, equal)
    if pareto is not None or metric is None:
        board["front"] = pd.array(front(board, criteria, GROUP, CONTENDER), dtype="Int64")
    board.attrs |= {"level": level, "equal": equal, "pareto": criteria}
    return board


def _board(rows: pd.DataFrame, metrics: list[str], level: float, equal: float) -> pd.DataFrame:
    cells = _cells(rows, metrics)
    parts = [_group_board(cells, group, level, equal) for group in cells.groups()]
    return _joined(cells, [part for part in parts if part], costs(rows))


def _joined(cells: _Cells, parts: list[_Part], costs: pd.DataFrame) -> pd.DataFrame:
    if not parts:
        return pd.DataFrame(columns=list(COLUMNS))
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0] if name in (*COLUMNS, "row")}
    board = cells.keys.iloc[columns.pop("row")].reset_index(drop=True).assign(**columns)
    board["better"] = np.array([*cells.better, ""], dtype=object)[board["metric"]]
    board["metric"] = np.array([*cells.metrics, ""], dtype=object)[board["metric"]]
    board = board.join(costs, on=[*GROUP, *CONTENDER])
    for name in ("rank_low", "rank_high"):
        board[name] = board[name].astype("Int64").mask(board["solved"] == 0)
    board["true_distances"] = board["true_distances"].fillna(0).astype("int64")
    board["front"] = pd.array([pd.NA] * len(board), dtype="Int64")
    return board[list(COLUMNS)]


@dataclass
class _Cells:
    """Rows gathered per group, case, seed and contender, sorted by these; arrays are (cells, metrics).

    Results have one row of each kind; several are averaged.
    """

    keys: pd.DataFrame  # the columns GROUP, UNIT, CONTENDER of each cell
    codes: np.ndarray  # (cells, columns) the same as integers that sort alike
    metrics: list[str]
    better: list[str]
    planned: np.ndarray  # number of planned rows
    solved: np.ndarray  # how many were
    imputed: np.ndarray  # number of failed rows with the score of the worst pseudo-method
    score: np.ndarray  # mean score over the solved and the imputed rows, 0 without
    value: np.ndarray  # as shown: the same, but for a "reference" metric the distance from the reference's value
    badness: np.ndarray  # the same as "lower is better"
    floor: np.ndarray  # NaN where unknown
    rows: np.ndarray  # (cells,) number of rows
    mute: np.ndarray  # (cells,) whether all rows of the group failed, so that none names its metrics

    def groups(self) -> list[slice]:
        """The cells of each group."""
        starts = _starts(self.codes[:, _GROUP])
        return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(self.codes)], strict=True)]


def _cells(rows: pd.DataFrame, metrics: list[str]) -> _Cells:
    rows, codes = _sorted(rows)
    starts = _starts(codes)
    ok = (rows["status"] == "ok").to_numpy()
    declared, better = _declared(rows, metrics)
    score = rows[[f"score.{m}" for m in metrics]].to_numpy(dtype=float)
    floor = rows.reindex(columns=[f"floor.{m}" for m in metrics]).to_numpy(dtype=float)
    worst = rows.reindex(columns=[f"{PREFIX}{m}" for m in metrics]).to_numpy(dtype=float)
    badness = _badness(score, floor, better)
    # Without the reference's own value the distance of a score from it is unknown.
    solved = ok[:, None] & np.isfinite(badness)
    declared |= solved
    planned = declared | ~ok[:, None]

    # A metric that never applies to a method (normals of a method without any) is not a failure of its cases;
    # a method that failed on all of them counts as missing all metrics of the group.
    group, contender = _ids(codes[:, _GROUP]), _ids(np.delete(codes, _UNIT, axis=1))
    never_ok = ~_any_by(contender, ok[:, None])
    planned &= never_ok | _any_by(contender, declared)
    planned &= _any_by(group, declared)
    mute = ~_any_by(group, ok[:, None])[:, 0]
    imputed = planned & ~solved & np.isfinite(_badness(worst, floor, better))
    known = solved | imputed
    score, badness = np.where(solved, score, worst), np.where(solved, badness, _badness(worst, floor, better))

    def total(array: np.ndarray) -> np.ndarray:
        return np.add.reduceat(array, starts, axis=0)

    count, floored = total(known.astype(int)), solved & np.isfinite(floor)
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = total(np.where(floored, floor, 0.0)) / total(floored.astype(int))
    return _Cells(
        keys=rows[[*GROUP, *UNIT, *CONTENDER]].iloc[starts].reset_index(drop=True),
        codes=codes[starts],
        metrics=metrics,
        better=better,
        planned=total(planned.astype(int)),
        solved=total(solved.astype(int)),
        imputed=total(imputed.astype(int)),
        score=total(np.where(known, score, 0.0)) / np.maximum(count, 1),
        # Signed differences of several cases would cancel in a mean: genus 5 too high and 5 too low is not perfect.
        value=total(np.where(known, np.where(_to_reference(better), badness, score), 0.0)) / np.maximum(count, 1),
        badness=total(np.where(known, badness, 0.0)) / np.maximum(count, 1),
        floor=floor,
        rows=total(np.ones(len(rows), dtype=int)),
        mute=mute[starts],
    )


def _sorted(rows: pd.DataFrame) -> tuple[pd.DataFrame, np.ndarray]:
    """The rows by group, unit and contender, and these as integers.

    Rows within one cell are sorted too, so that not even the last digit of a sum depends on the
    order of the input.
    """
    names = [*GROUP, *UNIT, *CONTENDER, *(["finished"] if "finished" in rows else [])]
    codes = np.column_stack([pd.factorize(rows[name], sort=True)[0] for name in names])
    order = np.lexsort(codes.T[::-1])
    return rows.iloc[order], codes[order, : _CONTENDER.stop]


def _declared(rows: pd.DataFrame, metrics: list[str]) -> tuple[np.ndarray, list[str]]:
    """The declared metrics of each row, and the direction of each metric.

    A failed row declares nothing, even if it has the scores of hopeless outputs.
    """
    failed = (rows["status"] != "ok").to_numpy()
    codes, texts = pd.factorize(rows["directions"].fillna(""), sort=True)
    said = [json.loads(text) if text else {} for text in texts]
    table = np.array([[m in s for m in metrics] for s in said], dtype=bool).reshape(len(said), len(metrics))
    better = [next((s[m] for s in said if m in s), "lower") for m in metrics]
    return table[codes] & ~failed[:, None], better


def _to_reference(better: list[str]) -> np.ndarray:
    """(metrics,) bool array: which should be near the reference's own value."""
    return np.array(better, dtype=str) == "reference"


def _badness(score: np.ndarray, floor: np.ndarray, better: list[str]) -> np.ndarray:
    """Scores such that lower is better: for a ``reference`` metric, the distance from the reference's own value."""
    direction = np.array(better, dtype=str)
    with np.errstate(invalid="ignore"):
        distance = abs(score - floor)
    return np.where(direction == "reference", distance, np.where(direction == "higher", -score, score))


def _starts(codes: np.ndarray) -> np.ndarray:
    """Where a new value begins in rows of integers whose equal ones are neighbours."""
    return np.flatnonzero(np.r_[True, (codes[1:] != codes[:-1]).any(axis=1)][: len(codes)])


def _ids(codes: np.ndarray) -> np.ndarray:
    """One integer for each different row of ``codes``, counted from 0 in their order."""
    packed = np.zeros(len(codes), dtype=np.int64)
    for column in codes.T:
        packed = np.unique(packed * (column.max(initial=0) + 1) + column, return_inverse=True)[1]
    return packed


def _any_by(ids: np.ndarray, flags: np.ndarray) -> np.ndarray:
    """For each row, whether any row with its id has the flag; column by column."""
    found = np.empty_like(flags)
    for j, column in enumerate(flags.T):
        found[:, j] = np.bincount(ids, weights=column)[ids] > 0
    return found


def _clipped(low: np.ndarray, high: np.ndarray, scores: np.ndarray, better: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Intervals, (contenders, metrics), clipped to possible scores: no distance is negative, no share above 1.

    With few cases an interval may exceed these bounds. A metric whose scores (units, contenders, metrics) are all
    at least 0 is taken to have no negative ones; one that is better when higher, with scores in 0..1, to be a share;
    so is one whose scores are all 0 or 1.
    """
    positive = (scores >= 0).all(axis=(0, 1))
    share = positive & (scores <= 1).all(axis=(0, 1)) & (np.array(better) == "higher")
    share |= np.isin(scores, (0, 1)).all(axis=(0, 1))  # yes or no
    return np.where(positive, np.maximum(low, 0), low), np.where(share, np.minimum(high, 1), high)


# -- one group ---------------------------------------------------------------------------------------------------------


def _group_board(cells: _Cells, group: slice, level: float, equal: float) -> _Part:
    """The board of one table."""
    codes = cells.codes[group]
    unit, contender = _ids(codes[:, _UNIT]), _ids(codes[:, _CONTENDER])
    first = np.unique(contender, return_index=True)[1]
    used = np.flatnonzero(cells.planned[group].any(axis=0))
    if not len(used):
        return _unscored(cells, group, first, contender)

    def cube(array: np.ndarray, empty: float = 0) -> np.ndarray:
        """(units, contenders, used metrics); ``empty`` where a contender was not run."""
        full = np.full((unit.max() + 1, len(first), len(used)), empty, dtype=array.dtype)
        full[unit, contender] = array[group][:, used]
        return full

    planned, solved, floor = cube(cells.planned), cube(cells.solved), cube(cells.floor, np.nan)
    known = cube(cells.solved + cells.imputed)
    units = codes[np.unique(unit, return_index=True)[1]]
    cases = _starts(units[:, _CASE])
    # With a single shape only the seeds vary: the interval is then about this shape, not about others.
    clusters = cases if len(cases) > 1 else _starts(units[:, _SEEDED])

    scores = cube(cells.value)
    sums = np.add.reduceat(scores, clusters).reshape(len(clusters), -1)
    counts = np.add.reduceat((known > 0).astype(float), clusters).reshape(len(clusters), -1)
    mean, low, high = (a.reshape(len(first), -1) for a in mean_intervals(sums, counts, level))
    low, high = _clipped(low, high, scores, [cells.better[m] for m in used])
    mean, low, high = (np.where(solved.any(axis=0), array, np.nan) for array in (mean, low, high))

    values = penalise(cube(cells.badness), known == planned)
    shapes = np.logical_or.reduceat(planned > 0, cases).sum(axis=0)
    is_solved = np.asarray(solved.any(axis=0))
    standings = _standings(values, planned > 0, is_solved, clusters, level, shapes)
    floors = np.isfinite(floor).sum(axis=0)
    table = {
        "row": np.broadcast_to(group.start + first[:, None], mean.shape),
        "metric": np.broadcast_to(used, mean.shape),
        "mean": mean,
        "ci_low": low,
        "ci_high": high,
        "floor": np.where(floors > 0, np.nansum(floor, axis=0) / np.maximum(floors, 1), np.nan),
        "rank_low": standings.low,
        "rank_high": standings.high,
        "order": standings.order,
        "solved": solved.sum(axis=0),
        "imputed": known.sum(axis=0) - solved.sum(axis=0),
        "planned": planned.sum(axis=0),
    }
    table |= resolve(standings, is_solved, level, equal)
    table |= _missed(unit, contender, planned > 0)
    reference = _to_reference(cells.better)[used]
    table["score_mean"] = np.where(reference & solved.any(axis=0), _mean(cube(cells.score), known > 0), np.nan)
    table["place"] = _places(table, [cells.better[m] for m in used], shapes)
    # By metric, then rank; equal ones stay in the order of their names, as `resolve` has them.
    place = np.lexsort([table[c].ravel() for c in ("rank_high", "order", "rank_low", "metric")])
    place = place[table["planned"].ravel()[place] > 0]
    return {name: array.ravel()[place] for name, array in table.items()}


def _places(table: _Part, better: list[str], shapes: np.ndarray) -> np.ndarray:
    """The best means; none if there are too few shapes for ranks, or if only one of several methods has a score."""
    planned, solved = table["planned"], table["solved"]
    scored = (planned > 0).sum(axis=0)
    ranked = (rankable(shapes) & (scored > 1)) | (len(planned) == 1)  # a single one is, on any number of shapes
    badness = np.where(np.array(better) == "higher", -table["mean"], table["mean"])
    first = (table["rank_low"] == 1) & ranked
    return places(badness, first, first.any(axis=0) & (solved == planned))


def penalise(badness: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Give units without a known score a value that is worse than any answer.

    So much worse that the relative difference to any answer is 1, the maximum: the cost of a failure against
    one method then does not depend on which others are shown.

    Parameters
    ----------
    badness : (units, k, m) array
        Lower is better.
    known : (units, k, m) bool array
        Whether the unit was solved, or has the score of the worst pseudo-method.

    Returns
    -------
    (units, k, m) array
    """
    largest = abs(np.where(known, badness, 0.0)).max(axis=(0, 1))
    return np.where(known, badness, FAR * np.where(largest > 0, largest, 1.0))


def _standings(
    values: np.ndarray, planned: np.ndarray, some: np.ndarray, clusters: np.ndarray, level: float, shapes: np.ndarray
) -> Standings:
    """Rank intervals; methods that solved nothing share the last places, by definition and not by a test.

    If there are too few shapes to rank methods, all that solved something share the first places.
    """
    difference, significant = significant_differences(values, planned & some, clusters, level)
    significant &= rankable(shapes)
    low, high, order = ranks_of(difference, significant, planned & some)
    last, everyone = some.sum(axis=0) + 1, planned.any(axis=0).sum(axis=0)
    low, high, order = np.where(some, low, last), np.where(some, high, everyone), np.where(some, order, len(some))
    return Standings(values, planned & some, clusters, low, high, order, significant, shapes)


def _mean(scores: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(contenders, metrics): the mean of (units, contenders, metrics) over the known ones; 0 without."""
    return scores.sum(axis=0) / np.maximum(known.sum(axis=0), 1)


def _missed(unit: np.ndarray, contender: np.ndarray, planned: np.ndarray) -> _Part:
    """The numbers of units on which each contender was not run, and on which a metric is undefined for it alone."""
    ran = np.zeros(planned.shape[:2], dtype=bool)
    ran[unit, contender] = True
    undefined = ran[..., None] & ~planned & planned.any(axis=1, keepdims=True)
    not_run = np.broadcast_to((~ran).sum(axis=0)[:, None], planned.shape[1:])
    return {"not_run": not_run, "undefined": undefined.sum(axis=0)}


def _unscored(cells: _Cells, group: slice, first: np.ndarray, contender: np.ndarray) -> _Part:
    """Lines for a group in which all failed and no metric is known: it must not vanish."""
    if not cells.mute[group].all():
        return {}
    k = len(first)
    unknown = ("mean", "ci_low", "ci_high", "floor", "score_mean", "detectable", "more_shapes")
    part = {name: np.full(k, np.nan) for name in unknown}
    part |= {name: np.full(k, "", dtype=object) for name in ("versus_next", "versus_first", "place")}
    part |= {name: np.full(k, n) for name, n in (("metric", -1), ("rank_low", 1), ("rank_high", k))}
    part |= {name: np.zeros(k, dtype=int) for name in ("solved", "imputed", "shapes", "not_run", "undefined")}
    return part | {"row": group.start + first, "planned": np.bincount(contender, cells.rows[group]).astype(int)}


# -- the scores themselves ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class UnitScores:
    """The scores of the methods of one table on each unit (case, seed and sensor), by one metric."""

    units: pd.DataFrame  # the columns UNIT; the units of one case are neighbours
    contenders: pd.DataFrame  # the columns CONTENDER
    values: np.ndarray  # (units, contenders), lower is better; failures as the ranks count them
    planned: np.ndarray  # (units, contenders) whether the unit was planned for the method


def unit_scores(rows: pd.DataFrame, metric: str) -> UnitScores:
    """The scores behind a table of one metric.

    Parameters
    ----------
    rows : DataFrame
        Of one table: pooled by :func:`bench.ranking.selection.pool`, of one task and split.
    metric : str
    """
    cells = _cells(rows, [metric])
    unit, contender = _ids(cells.codes[:, _UNIT]), _ids(cells.codes[:, _CONTENDER])
    places, lines = (np.unique(ids, return_index=True)[1] for ids in (unit, contender))

    def cube(array: np.ndarray) -> np.ndarray:
        full = np.zeros((len(places), len(lines), 1), dtype=array.dtype)
        full[unit, contender] = array
        return full

    planned = cube(cells.planned) > 0
    known = cube(cells.solved + cells.imputed) == cube(cells.planned)
    values = penalise(cube(cells.badness), known & planned)
    return UnitScores(
        cells.keys.iloc[places][UNIT].reset_index(drop=True),
        cells.keys.iloc[lines][CONTENDER].reset_index(drop=True),
        values[..., 0],
        planned[..., 0],
    )


def unit_values(rows: pd.DataFrame, metric: str) -> pd.DataFrame:
    """The score of each method on each unit (case, seed and sensor) by one metric, as shown in tables.

    Parameters
    ----------
    rows : DataFrame
        Pooled by :func:`bench.ranking.selection.pool`, with the known worst scores (:func:`imputation.lent`).
    metric : str

    Returns
    -------
    DataFrame
        Columns ``task, dataset, sensor, split, case, seed, condition, method, variant, threads, device, host``;
        ``better``; ``value`` (as ``mean`` of a board; missing where it is not known); ``badness`` (the same such that
        lower is better); ``planned``, ``solved`` and ``imputed``, how many results of the unit. Only what was to be
        scored by the metric.
    """
    cells = _cells(rows, [metric])
    known = cells.solved[:, 0] + cells.imputed[:, 0] > 0
    frame = cells.keys.assign(
        better=cells.better[0],
        value=np.where(known, cells.value[:, 0], np.nan),
        badness=np.where(known, cells.badness[:, 0], np.nan),
        planned=cells.planned[:, 0],
        solved=cells.solved[:, 0],
        imputed=cells.imputed[:, 0],
    )
    return frame[frame["planned"] > 0].reset_index(drop=True)


# -- what else a reader wants to know ----------------------------------------------------------------------------------


def costs(rows: pd.DataFrame) -> pd.DataFrame:
    """Per group and contender, over solved cases.

    Returns
    -------
    DataFrame
        Index ``task, dataset, sensor, split, method, variant, threads, device, host``; columns ``seconds_median``,
        ``peak_rss_mb`` (the largest), ``parameters`` and ``active_parameters`` (of a learned method; missing where
        none), ``train_seconds`` and ``true_distances`` (the most points at which they were given; missing where none
        were).
    """
    # Results of earlier versions lack these columns.
    later = ("active_parameters", "true_distances", "train_seconds")
    rows = prepared(rows).assign(**{name: pd.to_numeric(rows[name]) if name in rows else np.nan for name in later})
    solved = rows[(rows["status"] == "ok").to_numpy()].groupby([*GROUP, *CONTENDER], sort=True)
    return pd.DataFrame(
        {
            "seconds_median": solved["seconds"].median(),
            "peak_rss_mb": solved["peak_rss_mb"].max(),
            "parameters": solved["parameters"].max(),
            "active_parameters": solved["active_parameters"].max(),
            "true_distances": solved["true_distances"].max(),
            "train_seconds": solved["train_seconds"].median(),
        }
    )


def failures(rows: pd.DataFrame) -> pd.DataFrame:
    """The failures: one row per group, contender, status and kind of message, with the count and the first message.

    Messages that differ only in names of files and in numbers are of one kind.

    Returns
    -------
    DataFrame
        Columns ``task, dataset, sensor, split, method, variant, threads, device, host, status, count, message, case``;
        the last is the case of the message.
    """
    return _told(rows, (rows["status"] != "ok").to_numpy())


def notes(rows: pd.DataFrame) -> pd.DataFrame:
    """The notes of methods on cases that they solved (:meth:`bench.Run.note`), counted like :func:`failures`."""
    said = rows["message"].fillna("").astype(str) != ""
    return _told(rows, ((rows["status"] == "ok") & said).to_numpy())


def _told(rows: pd.DataFrame, which: np.ndarray) -> pd.DataFrame:
    """How many of these rows each group, contender, status and kind of message has, and the first message."""
    # Prepared with all others, since the host of a line names the machines of its solved cases, too.
    rows = prepared(rows)[which].sort_values([*GROUP, *CONTENDER, "status", *UNIT], kind="stable")
    kinds = [_kind(message, case) for message, case in zip(rows["message"], rows["case"], strict=True)]
    grouped = rows.assign(kind=kinds).groupby([*GROUP, *CONTENDER, "status", "kind"], sort=False)
    told = grouped.agg(count=("message", "size"), message=("message", "first"), case=("case", "first")).reset_index()
    return told.sort_values([*GROUP, *CONTENDER, "status"], kind="stable").drop(columns="kind").reset_index(drop=True)


def _kind(message: Any, case: Any) -> str:
    """A message without the parts that differ between cases: names of files, numbers."""
    text = "" if message is None or message != message else str(message)
    return re.sub(rf"\S*[/\\]\S*|^{re.escape(str(case))}\b|[-+.\d]*\d[-+.,\de]*", "#", text)
