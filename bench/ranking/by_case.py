"""One metric on every case: cases as lines, methods as columns, as papers print it."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ..results.imputation import lent
from .leaderboard import leaderboard, unit_values
from .order import metric_order
from .resolution import EQUAL
from .selection import CONTENDER, GROUP, Names, completed, matching, metrics_of, pool, select, split_names
from .statistics import SAME

WORD = "case"  # of --by
COLUMNS = (*GROUP, "metric", "better", "case", *CONTENDER, "value", "planned", "solved", "imputed", "best")


def without_case(by: Names) -> list[str] | None:
    """The other keys of the tables; None without any, which means dataset and sensor."""
    return [word for word in split_names(by) if word != WORD] or None


def by_case(
    rows: pd.DataFrame,
    *,
    by: Names = None,
    metric: Names = None,
    level: float = 0.95,
    equal: float = EQUAL,
    **filters: Names,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The scores of each case, and the board with their means.

    Parameters
    ----------
    rows : DataFrame
        One row per planned case.
    by : str or list of str, optional
        Further keys of the tables: ``task``, ``dataset``, ``sensor``, ``tag``; by dataset and sensor without it.
    metric : str, optional
        One table for each; by default the one that ranks the methods of a task.
    level, equal, filters
        As for :func:`bench.ranking.leaderboard.leaderboard`.

    Returns
    -------
    scores : DataFrame
        With :data:`COLUMNS`, a line per case and method: ``value`` is the mean over the seeds of the case (and over its
        sensors, where a table holds several), with failures as in all means; ``best`` is 1 if no other
        method is better on the case, of those that solved it with every seed.
    board : DataFrame
        Of these metrics and tables.

    Raises
    ------
    UsageError
        For filters that match nothing.
    """
    groups = without_case(by)
    board = leaderboard(rows, by=groups, metric=metric, level=level, equal=equal, **filters)
    chosen = pool(select(lent(completed(rows)), **filters), groups)
    named = matching("metric", metric, metrics_of(rows)) if metric else None
    parts: list[pd.DataFrame] = []
    for group, lines in board.groupby(GROUP, sort=False):
        of_group = chosen[(chosen[GROUP] == list(group)).all(axis=1)]
        wanted = metric_order(lines.to_dict("records"))[:1] if named is None else named
        # Not every table has each metric: another task lacks it, or nothing was solved there.
        parts.extend(_scores(of_group, name) for name in wanted if (lines["metric"] == name).any())
    scores = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=list(COLUMNS))
    return scores, board


def _scores(rows: pd.DataFrame, metric: str) -> pd.DataFrame:
    """The lines of one table."""
    units = unit_values(rows, metric)
    keys = [*GROUP, "case", *CONTENDER]
    grouped = units.groupby(keys, sort=False, dropna=False)
    scores = grouped.agg(
        better=("better", "first"),
        value=("value", "mean"),
        badness=("badness", "mean"),
        planned=("planned", "sum"),
        solved=("solved", "sum"),
        imputed=("imputed", "sum"),
    ).reset_index()
    able = (scores["solved"] == scores["planned"]) & np.isfinite(scores["badness"])
    least = scores["badness"].where(able).groupby(scores["case"]).transform("min")
    size = scores["badness"].abs() + least.abs()
    scores["best"] = (able & ((scores["badness"] - least).abs() <= SAME * size)).astype(int)
    index = rows.groupby("case")["case_index"].min()
    dataset = scores["case"].str.rpartition("/")[0]  # of cases of several datasets
    scores = scores.assign(metric=metric, _dataset=dataset, _index=scores["case"].map(index))
    scores = scores.sort_values(["_dataset", "_index", "case"], kind="stable")
    return scores[list(COLUMNS)].reset_index(drop=True)
