"""Tables for the terminal: as wide as it is, in several blocks where the metrics need them, never cut off."""

from __future__ import annotations

import io
from collections.abc import Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from ...text import one_line
from .labels import label, setup, shown_setup
from .tables import CONTENDER, GROUP, Metric, Table, any_best, shared_notes, title_of

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table as RichTable
    from rich.text import Text

ARROWS = {"lower": "↓", "higher": "↑", "reference": "→ref", "difference": "|diff| ↓"}
GAP = 2  # blanks between columns
NOTES = 100  # columns that notes take even where the terminal is narrower
MOST_MESSAGE = 600  # letters of a failure's message; the rest is in the record
MOST_REMARKS = 30  # messages of one caption


def terminal(tables: list[Table], width: int = 120, color: bool = False) -> str:
    """The tables as text, each with its notes; what is to be noted of all of them comes last."""
    if not tables:
        return "No results.\n"
    own, shared = shared_notes(tables, *(["*: tied for first."] if any_best(tables) else []))
    texts = [_one(table, notes, width, color) for table, notes in zip(tables, own, strict=True)]
    return "\n".join(texts) + _print(_dim(shared, width), color)


def heading(metric: Metric) -> str:
    """``chamfer_l1_mean ↓ (1e-3)``."""
    unit = f" (1e{metric.exponent})" if metric.exponent else ""
    return f"{metric.name} {ARROWS[metric.better]}{unit}"


def blocks(table: Table, width: int) -> list[list[Metric]]:
    """The metrics, as many to a block as fit; the first block has the costs beside it."""
    left = _width(["method", *table.methods, "floor / reference"])
    room = width - left - sum(_width([title, *cells]) for title, cells in table.places)
    first = room - sum(_width([title, *cells]) for title, cells in table.costs)
    split: list[list[Metric]] = [[]]
    room_left = first
    for metric in table.metrics:
        wide = _width([heading(metric), metric.floor, *(c.text + c.mark + "*" for c in metric.cells)])
        if wide > room_left and split[-1]:
            split.append([])
            room_left = width - left
        split[-1].append(metric)
        room_left -= wide
    return split


def _width(cells: list[str]) -> int:
    from rich.cells import cell_len

    return max(map(cell_len, cells)) + GAP


def _one(table: Table, notes: tuple[str, ...], width: int, color: bool) -> str:
    from rich.text import Text

    parts = [Text(table.title, style="bold")]
    for i, metrics in enumerate(blocks(table, width)):
        parts += [_block(table, metrics, ranked=i == 0), Text()]
    return _print([*parts, *_dim(notes, width)], color)


def wrapped(notes: Sequence[str], width: int) -> list[str]:
    """Notes as wide as the terminal, each folded into lines that are set in from its second one on."""
    lines = [wrap(note, max(width, NOTES), subsequent_indent="  ", break_long_words=False) for note in notes]
    return ["\n".join(parts) for parts in lines]


def _dim(notes: tuple[str, ...], width: int) -> list:
    from rich.text import Text

    return [Text(note, style="dim") for note in wrapped(notes, width)]


def _block(table: Table, metrics: list[Metric], ranked: bool) -> RichTable:
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    grid = RichTable(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, GAP, 0, 0), pad_edge=False, header_style="")
    grid.add_column("method", no_wrap=True)
    places = table.places if ranked else []
    for title, _ in places:
        grid.add_column(title, no_wrap=True)
    for metric in metrics:
        grid.add_column(heading(metric), no_wrap=True)
    costs = table.costs if ranked else []
    for title, _ in costs:
        grid.add_column(title, no_wrap=True, justify="right")
    for i, method in enumerate(table.methods):
        scores = [_score(metric, i) for metric in metrics]
        grid.add_row(Text(method), *(p[i] for _, p in places), *scores, *(cells[i] for _, cells in costs))
    if any(metric.floor for metric in metrics):
        floors = [Text(metric.floor, style="dim") for metric in metrics]
        grid.add_row(Text("floor / reference", style="dim"), *("" for _ in places), *floors, *("" for _ in costs))
    return grid


def _score(metric: Metric, i: int):
    from rich.text import Text

    cell = metric.cells[i]
    # The star says the same as the bold letters, for files and for eyes that do not see bold.
    return Text(cell.text + ("*" if cell.best else "") + cell.mark, style="bold" if cell.best else "")


def remarks(board: pd.DataFrame, rows: pd.DataFrame, color: bool = False) -> str:
    """What failed in the groups of a board, and what was noted: how often, and the first message of each kind.

    Empty if there is nothing.
    """
    from rich.text import Text

    from ..leaderboard import failures, notes

    contenders = set(board[[*GROUP, *CONTENDER]].itertuples(index=False, name=None))
    lines = board[[*GROUP, *CONTENDER, "metric"]]
    setups = {group: shown_setup(part.to_dict("records")) for group, part in lines.groupby(GROUP)}
    parts = []
    for caption, told in (("Not solved", failures(rows)), ("Solved, with a note", notes(rows))):
        several = told.duplicated([*GROUP, *CONTENDER], keep=False)  # messages: which case is each of?
        found = [
            (line, named)
            for line, named in zip(told.to_dict("records"), several, strict=True)
            if tuple(line[c] for c in [*GROUP, *CONTENDER]) in contenders
        ]
        lines = [_remark(line, setups[tuple(line[name] for name in GROUP)], named) for line, named in found]
        lines, more = lines[:MOST_REMARKS], len(lines) - MOST_REMARKS
        lines += [Text(f"  and {more} other messages; the rows of the results have them all")] if more > 0 else []
        parts += [Text(f"\n{caption}", style="bold"), *lines] if lines else []
    return _print(parts, color) if parts else ""


def _remark(told: dict[str, Any], shown: tuple[str, ...], name_case: bool) -> Text:
    """One line of what failed or was noted."""
    from rich.text import Text

    message = one_line(" ".join(str(told["message"] or "").split()))
    message = message if len(message) <= MOST_MESSAGE else message[: MOST_MESSAGE - 1] + "…"
    case = one_line(str(told["case"]))
    message = f"{case}: {message}" if message and name_case and case not in message else message
    where = title_of(*(told[name] for name in GROUP))
    what = "" if told["status"] == "ok" else f" {told['status']}"
    who = label(told["method"], told["variant"], setup(told, shown))
    return Text(f"  {who}: {told['count']}{what} ({where}){': ' + message if message else ''}")


def _print(parts: list, color: bool) -> str:
    from rich.console import Console

    out = io.StringIO()
    # Wider than anything: the blocks were made to fit, and what does not fit must wrap rather than vanish.
    how = {"force_terminal": color, "no_color": not color, "highlight": False, "markup": False, "emoji": False}
    console = Console(file=out, width=10_000, **how)
    for part in parts:
        console.print(part, soft_wrap=True)
    return "".join(line.rstrip() + "\n" for line in out.getvalue().splitlines())
