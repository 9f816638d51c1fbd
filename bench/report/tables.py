"""A leaderboard pivoted for people: one table per task, dataset and sensor, one line per method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .numbers import count, plain, unit_exponent, with_interval

if TYPE_CHECKING:
    import pandas as pd

GROUP = ["task", "dataset", "sensor"]
FAILED = "†"  # behind a mean that leaves failed cases out


@dataclass(frozen=True)
class Cell:
    """A mean with its interval, or the mark that there is none."""

    text: str
    best: bool = False  # tied for the first rank
    mark: str = ""  # what to read in the notes


@dataclass(frozen=True)
class Metric:
    """One column of scores."""

    name: str
    better: str
    exponent: int  # the cells are to be multiplied by 10 to this
    cells: tuple[Cell, ...]
    floor: str  # the floor, or the reference's own value


@dataclass(frozen=True)
class Table:
    """One table; every tuple has one entry per method, best method first."""

    task: str
    dataset: str
    sensor: str
    methods: tuple[str, ...]
    ranks: tuple[str, ...]  # by the first metric
    metrics: tuple[Metric, ...]
    solved: tuple[str, ...]
    seconds: tuple[str, ...]
    memory: tuple[str, ...]
    parameters: tuple[str, ...]  # empty when no method has any
    notes: tuple[str, ...]

    @property
    def title(self) -> str:
        """``reconstruct · bumps · samples``."""
        return " · ".join((self.task, self.dataset, self.sensor))

    @property
    def costs(self) -> list[tuple[str, tuple[str, ...]]]:
        """The columns that are not scores: heading and cells."""
        columns = [("solved", self.solved), ("seconds", self.seconds), ("peak MB", self.memory)]
        return [*columns, ("params", self.parameters)] if self.parameters else columns


def tables(board: pd.DataFrame, rows: pd.DataFrame | None = None, metrics: Sequence[str] = ()) -> list[Table]:
    """The tables of a board, in its order."""
    parameters = _parameters(rows)
    level = board.attrs.get("level", 0.95)
    return [
        _table(label, part, parameters, metrics, level)
        for label, part in board.groupby(GROUP, sort=False, dropna=False)
    ]


def metric_order(part: pd.DataFrame, wanted: Sequence[str] = ()) -> list[str]:
    """The metrics of a table: those wanted first, then measured distances (they have a floor), then counts.

    A metric that is to be near the reference's own value says what a result is like rather than how good it is, so
    these stand last.
    """
    wanted = list(wanted)
    found = part[part["metric"] != ""].groupby("metric").agg({"better": "first", "floor": "max"})

    def key(name: str) -> tuple:
        place = wanted.index(name) if name in wanted else len(wanted)
        better, floor = found.loc[name]
        return place, ("lower", "higher", "reference").index(better), not math.isfinite(floor), name

    return sorted(found.index, key=key)


def _table(
    label: tuple, part: pd.DataFrame, parameters: dict[tuple, float], wanted: Sequence[str], level: float
) -> Table:
    part = part.assign(label=[_label(m, v) for m, v in zip(part["method"], part["variant"], strict=True)])
    names = metric_order(part, wanted)
    by_metric = {name: part[part["metric"] == name].set_index("label") for name in names}
    first = by_metric[names[0]] if names else part.set_index("label")
    methods = list(dict.fromkeys([*first.index, *part["label"]]))  # who has no such score stands at the end
    lines = part.drop_duplicates("label").set_index("label")
    most = part.loc[part.groupby("label")["solved"].idxmax()].set_index("label")
    counts = [parameters.get((*label, lines["method"][m], lines["variant"][m]), math.nan) for m in methods]
    columns = tuple(_metric(name, by_metric[name], methods, most) for name in names)
    return Table(
        *label,
        methods=tuple(methods),
        ranks=tuple(_rank(first, method) for method in methods),
        metrics=columns,
        solved=tuple(f"{most['solved'][m]}/{most['planned'][m]}" for m in methods),
        seconds=tuple(_seconds(lines["seconds_median"][m]) for m in methods),
        memory=tuple(_megabytes(lines["peak_rss_mb"][m]) for m in methods),
        parameters=tuple(map(count, counts)) if any(c > 0 for c in counts) else (),
        notes=_notes(part, columns, first, level),
    )


def _metric(name: str, part: pd.DataFrame, methods: list[str], most: pd.DataFrame) -> Metric:
    exponent = unit_exponent(part["mean"])
    cells = []
    for method in methods:
        if method not in part.index:
            cells.append(Cell(""))
            continue
        line = part.loc[method]
        mark = ""
        if 0 < line["solved"] < line["planned"]:
            same = (line["solved"], line["planned"]) == (most["solved"][method], most["planned"][method])
            mark = FAILED if same else f"{FAILED}{line['solved']}/{line['planned']}"
        text = with_interval(line["mean"], line["ci_low"], line["ci_high"], exponent)
        cells.append(Cell(text, bool(line["rank_low"] == 1 and math.isfinite(line["mean"])), mark))
    floors = sorted({plain(f, exponent) for f in part["floor"] if math.isfinite(f)}, key=float)
    floor = floors[0] if len(floors) == 1 else f"{floors[0]} to {floors[-1]}" if floors else ""
    return Metric(name, part["better"].iloc[0], exponent, tuple(cells), floor)


def _notes(part: pd.DataFrame, columns: tuple[Metric, ...], first: pd.DataFrame, level: float) -> tuple[str, ...]:
    notes = []
    if columns:
        notes.append(f"rank: by {columns[0].name}, {level:.0%} interval; methods whose intervals overlap may be equal.")
        notes.append(
            f"mean [{level:.0%} bootstrap interval over cases]; seconds: median; peak MB: largest, of solved cases."
        )
    if any(c.exponent for c in columns):
        notes.append("A power of ten beside a metric: its numbers are in that unit.")
    if any(cell.mark for c in columns for cell in c.cells):
        notes.append(
            f"{FAILED} the mean leaves failed cases out; for the rank, a failed case is worse than every solved result "
            "on that case."
        )
    if first["planned"].nunique() > 1:
        notes.append("Methods were run on different cases; ranks compare each two on what both were run on.")
    if any(math.isfinite(m) and not math.isfinite(low) for m, low in zip(part["mean"], part["ci_low"], strict=True)):
        notes.append("No interval: a single case, from which nothing follows for others.")
    return tuple(notes)


def _rank(first: pd.DataFrame, method: str) -> str:
    if method not in first.index:
        return "-"
    low, high = first.loc[method, ["rank_low", "rank_high"]]
    return str(low) if low == high else f"{low}-{high}"


def _label(method: str, variant: str) -> str:
    return f"{method} ({variant.replace(',', ', ')})" if variant else method


def _seconds(value: float) -> str:
    return "-" if not math.isfinite(value) else f"{value:.3f}" if value < 1 else f"{value:.3g}"


def _megabytes(value: float) -> str:
    return "-" if not math.isfinite(value) else f"{value:,.0f}"


def _parameters(rows: pd.DataFrame | None) -> dict[tuple, float]:
    if rows is None:
        return {}
    from ..leaderboard import costs

    learned = costs(rows)["parameters"].dropna()
    return {key: float(value) for key, value in learned.items()}
