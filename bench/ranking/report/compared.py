"""Two sets of results, printed beside each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pandas as pd

from ...text import counted
from ..compared import SHORTEST, Compared
from .cells import csv
from .grids import Grid, rendered
from .labels import label

FORMATS = ("terminal", "markdown", "csv")
ORDER = ("worse", "slower", "open", "better", "faster", "same", "short")
MOST = 10  # lines of one kind of change


def render_compared(found: Compared, format: str = "terminal", *, full: bool = False, width: int = 120) -> str:
    """What changed, as text.

    Parameters
    ----------
    found : Compared
    format : str
        ``terminal``, ``markdown``, or ``csv``: all lines of quality and speed in full precision.
    full : bool
        Whether to show unchanged lines, too, and every failed case.
    width : int
        Of the terminal.
    """
    if format == "csv":
        return csv(as_frame(found))
    grids = [_quality(found, full), _speed(found), *_cases(found, full)]
    return rendered([grid for grid in grids if grid], format, width)


def as_frame(found: Compared) -> pd.DataFrame:
    """Quality and speed in one table: of speed the metric is ``seconds``, and the change that of the ratio."""
    speed = found.speed.assign(
        metric="seconds",
        change=found.speed["ratio"].astype(float) - 1,
        low=found.speed["low"].astype(float) - 1,
        high=found.speed["high"].astype(float) - 1,
    )
    columns = [*found.quality.columns, "normalised"]
    parts = [part for part in (found.quality, speed.drop(columns="ratio")) if len(part)]
    return pd.concat(parts, ignore_index=True).reindex(columns=columns) if parts else pd.DataFrame(columns=columns)


def _sorted(lines: pd.DataFrame) -> list[dict[str, Any]]:
    place = {word: number for number, word in enumerate(ORDER)}
    return sorted(lines.to_dict("records"), key=lambda line: place[line["verdict"]])


def _name(line: dict[str, Any], several_tasks: bool) -> str:
    extra = [line["task"]] if several_tasks else []
    extra += ["train"] if line["split"] == "train" else []
    extra += [line["device"]] if line["device"] != "cpu" else []
    extra += [counted(line["threads"], "thread")] if line["threads"] > 1 else []
    return label(line["method"], line["variant"], ", ".join(extra))


def _quality(found: Compared, full: bool) -> Grid | None:
    several = found.quality["task"].nunique() > 1
    lines = [line for line in _sorted(found.quality) if full or line["verdict"] != "same"]
    same = len(found.quality) - len(lines)
    cells = tuple(
        (
            _name(line, several),
            line["metric"],
            _number(line["then"]),
            _number(line["now"]),
            _with_interval(line, 0.0),
            str(line["shapes"]),
            line["verdict"],
        )
        for line in lines
    )
    notes = [
        f"worse, better: significantly, by more than {100 * found.worse:.3g}%, all "
        f"lines together at {found.level:.0%} (Holm); same: within that; open: neither is shown.",
        f"change: of the badness, + is worse [{found.level:.0%} interval over shapes].",
        *found.notes,
    ]
    if same and not full:
        notes.insert(0, f"{counted(same, 'more line')} the same.")
    head = ("method", "metric", "then", "now", "change", "shapes", "verdict")
    return Grid(f"quality: {counted(found.pairs, 'pair')} of cases", head, cells, tuple(notes))


def _with_interval(line: dict[str, Any], offset: float) -> str:
    value = line["change"] if "change" in line else line["ratio"] - 1
    low, high = line["low"] - offset, line["high"] - offset
    text = _percent(value)
    return text if math.isnan(low) else f"{text} [{_percent(low)}, {_percent(high)}]"


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "-"


def _percent(value: float) -> str:
    return f"{100 * value:+.1f}%" if abs(value) < 10 else "> 1000%"


def _speed(found: Compared) -> Grid | None:
    if not len(found.speed):
        return None
    several = found.speed["task"].nunique() > 1
    cells = tuple(
        (
            _name(line, several),
            _number(line["then"]),
            _number(line["now"]),
            _with_interval(line, 1.0),
            line["time"],
            "yes" if line["normalised"] else "no",
            str(line["units"]),
            line["verdict"],
        )
        for line in _sorted(found.speed)
    )
    notes = (
        f"change: the median of the paired ratios, of seconds in units of a fixed workload timed before each call; "
        f"time: processor seconds of one thread, wall seconds of several and of GPUs. "
        f"slower, faster: significantly, by more than {100 * found.slower:.3g}%; "
        f"short: less than {SHORTEST:g} s, not judged.",
    )
    head = ("method", "then (s)", "now (s)", "change", "time", "normalised", "pairs", "verdict")
    return Grid("speed", head, cells, notes)


def _cases(found: Compared, full: bool) -> list[Grid]:
    """The cases that only one side has, or only one side solved."""
    grids = []
    for title, rows in (("failed now, solved then", found.failed), ("solved now, failed then", found.solved)):
        side = "now" if rows is found.failed else "then"
        lines = [
            (
                label(row["method"], row["variant"]),
                f"{row['dataset']} {row['case']}",
                row["sensor"] or "-",
                str(row["seed"]),
                f"{row[f'status_{side}']}: {row[f'message_{side}']}"[:200],
            )
            for row in rows.fillna({f"message_{side}": ""}).to_dict("records")
        ]
        grids.append(_some(title, ("method", "case", "sensor", "seed", "message"), lines, full))
    for title, rows in (("new: missing then", found.new), ("gone: missing now", found.gone)):
        lines = [
            (label(row["method"], row["variant"]), row["task"], row["dataset"], row["sensor"] or "-", str(row["cases"]))
            for row in rows.to_dict("records")
        ]
        grids.append(_some(title, ("method", "task", "dataset", "sensor", "cases"), lines, full))
    return [grid for grid in grids if grid]


def _some(title: str, head: tuple[str, ...], lines: Sequence[tuple[str, ...]], full: bool) -> Grid | None:
    if not lines:
        return None
    shown = lines if full else lines[:MOST]
    rest = len(lines) - len(shown)
    return Grid(title, head, tuple(shown), (f"and {rest} more: --full",) if rest else ())
