"""One metric in all groups side by side: the strengths of each method."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from ..errors import UsageError
from .leaderboard import leaderboard
from .order import metric_order
from .resolution import EQUAL
from .selection import Names, matching, pool, select

GROUPS = ("dataset", "sensor", "tag")


def overview(
    rows: pd.DataFrame,
    across: str,
    *,
    metric: Names = None,
    level: float = 0.95,
    equal: float = EQUAL,
    **filters: Names,
) -> pd.DataFrame:
    """A board of one metric: over all cases of a task, and over those of each dataset, sensor or challenge tag.

    Parameters
    ----------
    rows : DataFrame
        One row per planned case.
    across : str
        ``dataset``, ``sensor`` or ``tag``.
    metric : str, optional
        The first one is used; by default, for each task, the one that ranks the methods on other boards.
    level, equal, filters
        As for :func:`bench.ranking.leaderboard.leaderboard`.

    Returns
    -------
    DataFrame
        As of :func:`leaderboard.leaderboard`. ``metric`` is the metric's name in the lines over all cases, and
        the group's name (``thin``, ``cad``, ``scanned``) in the others; intervals and ranks are within the group.

    Raises
    ------
    UsageError
        For another value, or filters that match nothing.
    """
    chosen = matching("across", across, GROUPS)
    if len(chosen) > 1:
        raise UsageError(f"across {across}: expected one of {', '.join(GROUPS)}; for several see --by")
    rows = select(rows, **filters)
    rows = rows.assign(host=pool(rows, "task")["host"].to_numpy())  # a line has one name in all columns
    board = leaderboard(rows, by="task", metric=metric, level=level, equal=equal)
    wanted = matching("metric", metric, board["metric"].unique()) if metric else ()
    heads = {task: _head(lines, wanted) for task, lines in board.groupby("task")}
    heads = {task: head for task, head in heads.items() if head}
    if not heads:
        raise UsageError(f"across {across}: nothing was solved yet, so there is no metric to show")
    parts = leaderboard(rows, by=chosen, metric=sorted(set(heads.values())), level=level, equal=equal)
    whole, parts = (lines[lines["metric"] == lines["task"].map(heads)] for lines in (board, parts))
    groups = parts["sensor" if chosen == ["sensor"] else "dataset"]
    parts = parts.assign(metric=groups, dataset=whole["dataset"].iloc[0], sensor=whole["sensor"].iloc[0])
    return pd.concat([whole, parts]).sort_values(["task", "split"], kind="stable", ignore_index=True)


def _head(lines: pd.DataFrame, wanted: Sequence[str]) -> str:
    """The metric that ranks a task's table; empty if nothing was solved."""
    return next((name for name in metric_order(lines.to_dict("records"), wanted) if name), "")
