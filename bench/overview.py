"""One metric in all groups side by side: who is good at what."""

from __future__ import annotations

import pandas as pd

from .errors import UsageError
from .leaderboard import leaderboard
from .report.tables import metric_order
from .selection import Names, matching, pool, select

GROUPS = ("dataset", "sensor", "tag")


def overview(
    rows: pd.DataFrame, across: str, *, metric: Names = None, level: float = 0.95, **filters: Names
) -> pd.DataFrame:
    """A board of one metric: over all cases of a task, and over those of each dataset, sensor or challenge tag.

    Parameters
    ----------
    rows : DataFrame
        One row per planned case.
    across : str
        ``dataset``, ``sensor`` or ``tag``.
    metric : str, optional
        The first one counts; by default the one that ranks the methods on other boards.
    level, filters
        As for :func:`bench.leaderboard.leaderboard`.

    Returns
    -------
    DataFrame
        As of :func:`bench.leaderboard.leaderboard`. ``metric`` is the metric's name in the lines over all cases, and
        the group's name (``thin``, ``cad``, ``scanned``) in the others; intervals and ranks are within the group.

    Raises
    ------
    UsageError
        For another word, or filters that match nothing.
    """
    chosen = matching("across", across, GROUPS)
    if len(chosen) > 1:
        raise UsageError(f"across {across}: expected one of {', '.join(GROUPS)}; for several see --by")
    rows = select(rows, **filters)
    rows = rows.assign(host=pool(rows, "task")["host"].to_numpy())  # a line has one name in all columns
    board = leaderboard(rows, by="task", metric=metric, level=level)
    wanted = matching("metric", metric, board["metric"].unique()) if metric else ()
    names = [name for name in metric_order(board.to_dict("records"), wanted) if name]
    if not names:
        raise UsageError(f"across {across}: nothing was solved yet, so there is no metric to show")
    name = names[0]
    parts = leaderboard(rows, by=chosen, metric=name, level=level)
    whole = board[board["metric"] == name]
    groups = parts["sensor" if chosen == ["sensor"] else "dataset"]
    parts = parts.assign(metric=groups, dataset=whole["dataset"].iloc[0], sensor=whole["sensor"].iloc[0])
    joined = pd.concat([whole, parts], ignore_index=True).sort_values(
        ["task", "split"], kind="stable", ignore_index=True
    )
    joined.attrs["level"] = level
    return joined
