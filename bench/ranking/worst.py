"""The worst cases of a method: how much worse than the best other method, and which tags they share."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..errors import UsageError
from ..results.imputation import lent
from .leaderboard import unit_values
from .naming import naming
from .order import metric_order
from .selection import CONTENDER, GROUP, UNIT, Names, completed, matching, metrics_of, pool, select
from .statistics import holm_p

RATIO, SCORE = ORDERS = ("ratio", "score")
SHARE = 4  # one shape in this many is bad, for the tags
FEWEST = 8  # shapes: with fewer no tag can stand out


@dataclass(frozen=True)
class Tag:
    """How often a tag is among the bad shapes, and among all."""

    name: str
    bad: int
    of_bad: int
    shapes: int
    of_shapes: int
    p: float  # that this many or more are bad by chance: hypergeometric, one-sided
    p_holm: float  # the same, corrected for the number of tags


@dataclass(frozen=True)
class Worst:
    """The cases of one method in one task, the worst first."""

    task: str
    split: str
    method: str  # as in tables
    metric: str
    better: str
    order: str
    cases: pd.DataFrame  # see COLUMNS
    tags: tuple[Tag, ...]  # of the bad shapes, the least p first; empty with fewer than FEWEST shapes


COLUMNS = (
    *("task", "dataset", "sensor", "split", "case", "seed", "tags", "metric"),
    *("value", "best_method", "best_value", "ratio", "status", "message", "cell", "fingerprint", "output"),
)


def worst(
    rows: pd.DataFrame, method: str, *, metric: Names = None, order: str = RATIO, **filters: Names
) -> list[Worst]:
    """The cases of a method, the worst first, for each task and split.

    Parameters
    ----------
    rows : DataFrame
        One row per planned case.
    method : str
        A plugin, a preset, or ``plugin[variant]``; it must be one method in these rows.
    metric : str, optional
        The first one is used; by default the one that ranks the methods of the task.
    order : str
        ``ratio``: by how many times worse than the best other method; ``score``: by the score alone.
    filters
        See :func:`bench.ranking.selection.select`.

    Raises
    ------
    UsageError
        If the name means several methods, or no row is left.
    """
    rows = select(lent(completed(rows)), **filters)
    mine = select(rows, method=method)[["method", "variant"]].drop_duplicates()
    if len(mine) > 1:
        called = [f"{m}[{v}]" if v else m for m, v in mine.itertuples(index=False)]
        raise UsageError(f"{method}: is {len(mine)} methods here: {'; '.join(called[:8])}. Name one of them")
    who = next(mine.itertuples(index=False, name=None))
    found = []
    for (task, split), part in rows.groupby(["task", "split"], sort=True):
        if ((part["method"] == who[0]) & (part["variant"] == who[1])).any():
            found.append(_worst(task, split, pool(part), who, metric, order))
    return found


def _worst(task: str, split: str, rows: pd.DataFrame, who: tuple[str, str], metric: Names, order: str) -> Worst:
    name, better = _metric_of(task, rows, who, metric)
    units = unit_values(rows, name)
    own = (units["method"] == who[0]) & (units["variant"] == who[1])
    where = [*GROUP, *UNIT]
    labels = naming(units[["method", "variant"]].itertuples(index=False, name=None)).labels
    others = units[~own & (units["solved"] == units["planned"])].sort_values("badness", kind="stable")
    others = others.drop_duplicates(where)[[*where, "method", "variant", "value"]]
    others = others.assign(best_method=[labels[m, v] for m, v in zip(others["method"], others["variant"], strict=True)])
    others = others.rename(columns={"value": "best_value"})[[*where, "best_method", "best_value"]]
    cases = units[own].merge(others, on=where, how="left")
    cases["ratio"] = _ratios(cases, better)
    keep = [*where, *CONTENDER]
    facts = rows.drop_duplicates(keep)[[*keep, "tags", "status", "message", "cell", "fingerprint", *_kept(rows)]]
    cases = cases.merge(facts, on=keep, how="left").assign(metric=name)
    cases = cases.reindex(columns=[*COLUMNS, "badness"])
    bad = cases["ratio"] if order == RATIO else cases["badness"]
    unknown = cases["badness"].isna()  # failed, without a known score
    cases = cases.assign(_bad=np.where(unknown, np.inf, bad.fillna(-np.inf)))
    cases = cases.sort_values(["_bad", "dataset", "case", "sensor", "seed"], ascending=[False, *[True] * 4])
    tags = _tags(cases)
    return Worst(task, split, labels[who], name, better, order, cases[list(COLUMNS)].reset_index(drop=True), tags)


def _kept(rows: pd.DataFrame) -> list[str]:
    return ["output"] if "output" in rows else []


def _metric_of(task: str, rows: pd.DataFrame, who: tuple[str, str], metric: Names) -> tuple[str, str]:
    """The deciding metric, among those of the method, and its direction.

    Raises
    ------
    UsageError
        If the method has no score.
    """
    known = metrics_of(rows)
    lines = []
    for name in matching("metric", metric, known) if metric else known:
        units = unit_values(rows, name)
        own = units[(units["method"] == who[0]) & (units["variant"] == who[1])]
        if len(own) and units["solved"].any():
            floor = rows[f"floor.{name}"].mean() if f"floor.{name}" in rows else math.nan
            lines.append({"task": task, "metric": name, "better": own["better"].iloc[0], "floor": floor})
    if not lines:
        asked = f" by {metric}" if metric else ""
        raise UsageError(f"{who[0]}: has no score{asked} here: nothing was solved, or the metric is not for its output")
    first = lines[0]["metric"] if metric else metric_order(lines)[0]
    return first, next(line["better"] for line in lines if line["metric"] == first)


def _ratios(cases: pd.DataFrame, better: str) -> np.ndarray:
    """How many times worse than the best other method; NaN if there is none."""
    own, best = cases["value"].to_numpy(dtype=float), cases["best_value"].to_numpy(dtype=float)
    above, below = (best, own) if better == "higher" else (own, best)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = above / below
    return np.where(above == below, 1.0, ratios)


def _tags(cases: pd.DataFrame) -> tuple[Tag, ...]:
    """Which tags are over-represented in the worst quarter of the shapes; a shape counts once, by its worst case."""
    shapes = cases.drop_duplicates(["dataset", "case"])
    n = len(shapes)
    if n < FEWEST:
        return ()
    bad = math.ceil(n / SHARE)
    sets = [frozenset(filter(None, str(value or "").split(","))) for value in shapes["tags"]]
    counts = {tag: sum(tag in tags for tags in sets) for tag in sorted(set().union(*sets))}
    counts = {tag: count for tag, count in counts.items() if count < n}
    hits = {tag: sum(tag in tags for tags in sets[:bad]) for tag in counts}
    p = [_p_value(hits[tag], bad, count, n) for tag, count in counts.items()]
    found = [
        Tag(tag, hits[tag], bad, counts[tag], n, one, corrected)
        for tag, one, corrected in zip(counts, p, holm_p(p), strict=True)
        if hits[tag]
    ]
    return tuple(sorted(found, key=lambda tag: (tag.p, tag.name)))


def _p_value(hits: int, bad: int, tagged: int, shapes: int) -> float:
    """The chance that of ``bad`` shapes drawn from ``shapes``, ``hits`` or more are among the ``tagged`` ones."""
    ways = (math.comb(tagged, k) * math.comb(shapes - tagged, bad - k) for k in range(hits, min(bad, tagged) + 1))
    return sum(ways) / math.comb(shapes, bad)


def commands(cases: pd.DataFrame, folders: Sequence[str]) -> list[str]:
    """The command that runs the cell of each case again."""
    return [
        f"detailbench reproduce {line['cell']} results={shlex.quote(folder_of(line, folders))}"
        for line in _records(cases)
    ]


def folder_of(line: Mapping[str, Any], folders: Sequence[str]) -> str:
    """The folder whose record the row is from; the first one if none has it."""
    from ..results.store import Results

    for folder in folders:
        if Results(folder).path(line["cell"], line["fingerprint"]).exists():
            return folder
    return folders[0]


def outputs(cases: pd.DataFrame, folders: Sequence[str]) -> list[str]:
    """The stored output of each case; empty if none was stored, or the file is gone."""
    from ..results.store import Results

    found = []
    for line in _records(cases):
        path = Results(folder_of(line, folders)).output_of(line) if isinstance(line["output"], str) else None
        found.append(str(path) if path else "")
    return found


def _records(cases: pd.DataFrame) -> list[dict[str, Any]]:
    return cases.to_dict("records")
