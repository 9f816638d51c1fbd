"""Which methods are on the Pareto front of two criteria: metrics, or the costs of a method."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from ..errors import UsageError
from .headline import primary_metrics
from .selection import Names, matching
from .statistics import SAME

COSTS = {"seconds": "seconds_median", "peak_mb": "peak_rss_mb"}  # the columns of a board


def criteria_of(names: Names, metrics: Sequence[str]) -> tuple[str, ...]:
    """The two criteria that ``names`` mean, among the metrics and :data:`COSTS`; none for None.

    Raises
    ------
    UsageError
        If they are not two.
    """
    if names is None:
        return ()
    found = tuple(matching("pareto", names, [*metrics, *COSTS]))
    if len(found) != 2:
        raise UsageError(
            f"pareto {names}: expected two of the metrics and {', '.join(COSTS)}, as in p2f_mean,seconds; "
            f"got {len(found)}: {', '.join(found)}"
        )
    return found


def front(board: pd.DataFrame, criteria: tuple[str, ...], group: Sequence[str], contender: Sequence[str]) -> np.ndarray:
    """The column ``front`` of a board: 1 in the lines of the methods on the front, NaN in the others.

    A method is off the front only if another of its table is better in both criteria; another that is equal in one
    of them does not exclude it. Means are compared as printed, regardless of their uncertainty: see the
    intervals. A method without a mean in one of the criteria, such as one that solved nothing, is not on the front.

    Parameters
    ----------
    board : DataFrame
        Of :func:`bench.ranking.leaderboard.leaderboard`, with the lines of both criteria.
    criteria : two names, or none
        Metrics or :data:`COSTS`; if none are given, the primary metrics of each task that has two, see
        ``Task.primary``.
    group, contender : sequences of column names
        The keys of a table, including the task, and the keys of its lines.
    """
    column = np.full(len(board), np.nan)
    methods = board.groupby(list(contender), dropna=False).ngroup()
    for places in board.groupby(list(group), dropna=False).indices.values():
        chosen = criteria or primary_metrics(board["task"].iloc[places[0]])
        if len(chosen) != 2:
            continue
        lines = board.iloc[places]
        first, second = (_values(lines, methods.iloc[places], name) for name in chosen)
        both = pd.concat([first, second], axis=1).dropna()
        on = set(both.index[on_front(both.to_numpy())])
        column[places[methods.iloc[places].isin(on)]] = 1
    return column


def _values(lines: pd.DataFrame, methods: pd.Series, name: str) -> pd.Series:
    """The value of each method for a criterion, such that lower is better."""
    if name in COSTS:
        values = lines[COSTS[name]]
    else:
        lines = lines[lines["metric"] == name]
        values = lines["mean"] * np.where(lines["better"] == "higher", -1, 1)
    values = values.set_axis(methods.loc[lines.index])
    return values[~values.index.duplicated()]


def on_front(points: np.ndarray) -> np.ndarray:
    """(n,) bool array: which of (n, 2) points, lower is better, have no other that is smaller in both."""
    if not len(points):
        return np.zeros(0, dtype=bool)
    a, b = points[:, None], points[None]
    smaller = b < a - SAME * (abs(a) + abs(b))
    return ~np.any(smaller.all(axis=2), axis=1)
