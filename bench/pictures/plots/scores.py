"""The rows of a plot: one task, one metric, all datasets and sensors in one table, each method with its label."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...errors import UsageError
from ...ranking.headline import primary_metrics
from ...ranking.selection import CONTENDER, Names, matching, metrics_of, pool, select
from ..chosen import ordered_labels, renamed
from ..labels import labels
from ..printing import printable

if TYPE_CHECKING:
    import pandas as pd

    from ...results.store import Results

ARROWS = {"lower": " ↓", "higher": " ↑"}


@dataclass(frozen=True)
class Scores:
    """The data of a plot.

    Attributes
    ----------
    rows : DataFrame
        One task and split; with a column ``label``. Not pooled: datasets and sensors are as in the runs.
    metric : str
    direction : str
        ``lower``, ``higher`` or ``reference``.
    order : list of str
        The labels in the requested order, or by name.
    titles : mapping
        From labels to printed names.
    level : float
        Of intervals and tests.
    folders : sequence of Results
        Where the rows are from.
    """

    rows: pd.DataFrame
    metric: str
    direction: str
    order: list[str]
    titles: dict[str, str]
    level: float = 0.95
    folders: Sequence[Results] = ()
    is_ordered: bool = False

    @property
    def axis(self) -> str:
        """The metric with an arrow in its better direction."""
        if self.direction == "reference":
            return f"|{self.metric} - that of the reference|"
        return f"{self.metric}{ARROWS.get(self.direction, '')}"

    def label_of(self, lines: pd.DataFrame) -> list[str]:
        """The label of each line of a leaderboard, or of the contenders of a table."""
        pooled = self.pooled()
        known: dict[tuple, str] = {}
        # Two pools of the same rows may name the machines of a line differently: then the host does not help.
        for names in (CONTENDER[:-1], CONTENDER):
            keys = pooled[names].fillna("").itertuples(index=False)
            known |= {tuple(key): label for key, label in zip(keys, pooled["label"], strict=True)}
        wanted = lines[CONTENDER].fillna("").itertuples(index=False)
        return [known.get(tuple(line)) or known[tuple(line)[:-1]] for line in wanted]

    def pooled(self) -> pd.DataFrame:
        """The rows as one table."""
        return pool(self.rows, "task")

    def means(self, board: pd.DataFrame) -> dict[str, Any]:
        """The columns of a board for the table of a plot: means, their intervals, and how many cases were solved."""
        return {
            "metric": self.metric,
            "mean": board["mean"].astype(float),
            "low": board["ci_low"].astype(float),
            "high": board["ci_high"].astype(float),
            "solved": board["solved"].astype(int),
            "planned": board["planned"].astype(int),
        }

    def board(self, rows: pd.DataFrame | None = None, by: Names = "task") -> pd.DataFrame:
        """The lines of the leaderboard of some of the rows by the plot's metric, with a column ``label``.

        Means, intervals and the scores of failed cases are those of `detailbench leaderboard`.
        """
        from ...ranking.leaderboard import leaderboard

        rows = self.rows if rows is None else rows
        board = leaderboard(rows, by=by, metric=self.metric.replace("[", "[[]"), level=self.level)
        board = board[board["metric"] == self.metric]
        return board.assign(label=self.label_of(board))


def scores_of(
    rows: pd.DataFrame,
    folders: Sequence[Results],
    *,
    metric: str | None = None,
    method: Names = None,
    names: str | None = None,
    level: float = 0.95,
    **filters: Names,
) -> Scores:
    """The rows that a plot shows.

    Parameters
    ----------
    rows : DataFrame
    folders : sequence of Results
    metric : str
        One; the one that ranks the task if None.
    method : str or list of str
        Methods, presets or labels; all if None.
    names : str
        Their names: ``poisson=Poisson,mine=Ours``.
    level : float
    filters
        ``task``, ``dataset``, ``sensor``, ``split`` and ``tag``, as for :func:`bench.ranking.selection.select`.

    Raises
    ------
    UsageError
        For a name that no row has, and if the rows are of several tasks or splits.
    """
    from ...results.imputation import lent

    if not 0 < level < 1:
        raise UsageError(f"--level {level:g}: expected a number between 0 and 1")
    rows = select(lent(rows), **filters)
    for what in ("task", "split"):
        found = sorted(rows[what].unique()) if what in rows else []
        if len(found) > 1:
            raise UsageError(f"these are results of the {what}s {', '.join(found)}: choose one with --{what}")
    rows = rows.assign(label=labels(pool(rows, "task")))
    order = ordered_labels(rows, method)
    rows = rows[rows["label"].isin(order)].reset_index(drop=True)
    name = _metric(rows, metric)
    return Scores(
        rows=rows,
        metric=name,
        direction=_direction(rows, name),
        order=order,
        titles={label: printable(title) for label, title in renamed(names, order).items()},
        level=level,
        folders=folders,
        is_ordered=method is not None,
    )


def _metric(rows: pd.DataFrame, metric: str | None) -> str:
    """The metric of a plot: the named one, the one that ranks the task, or the only one."""
    known = metrics_of(rows)
    if metric is not None:
        found = matching("metric", metric, known)
        if len(found) > 1:
            raise UsageError(f"--metric {metric}: a plot shows one; choose one of {', '.join(found)}")
        return found[0]
    primary = [name for name in primary_metrics(rows["task"].iloc[0]) if name in known]
    if not primary and len(known) != 1:
        raise UsageError(f"--metric: choose one: {', '.join(known) or 'the results have none'}")
    return (primary or known)[0]


def _direction(rows: pd.DataFrame, metric: str) -> str:
    for text in rows["directions"].dropna().unique():
        if text and metric in (known := json.loads(text)):
            return known[metric]
    return "lower"


def rounded(table: pd.DataFrame) -> pd.DataFrame:
    """A table with numbers rounded so that differences in their last bits vanish."""
    numbers = table.select_dtypes("float").columns
    return table.assign(**{name: table[name].map(_rounded) for name in numbers})


def _rounded(value: Any) -> float:
    return float(f"{value:.10g}")
