"""Tables for the terminal: as wide as it is, in several blocks if the metrics need them, never cut off."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from ...text import counted, one_line
from ..naming import naming
from .labels import setup, shown_setup, with_setup
from .table import Cell, Column, Metric, Table, folded, shared_notes, standing_notes, title_of
from .tables import CONTENDER, GROUP

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table as RichTable
    from rich.text import Text

ARROWS = {"lower": "↓", "higher": "↑", "reference": "→ref", "difference": "|diff| ↓", "": ""}
GAP = 3  # blanks between columns
NOTES = 100  # columns for notes even if the terminal is narrower
MOST_MESSAGE = 600  # characters of a failure's message; the rest is in the record
MOST_REMARKS = 30  # messages of one caption


def terminal(tables: list[Table], width: int = 120, color: bool = False) -> str:
    """The tables as text, each with its notes; notes about all of them come last."""
    if not tables:
        return "No results.\n"
    own, shared = shared_notes(tables, *standing_notes(tables, "*", "Underlined" if color else ""))
    texts = [_one(table, notes, width, color) for table, notes in zip(tables, own, strict=True)]
    return "\n".join(texts) + _print(_dim(shared, width), color)


def heading(column: Column) -> str:
    """``chamfer_l1_mean ↓ (1e-3)``."""
    if not isinstance(column, Metric):
        return column.title
    unit = f" (1e{column.exponent})" if column.exponent else ""
    return f"{column.title or column.name} {ARROWS[column.better]}{unit}".rstrip()


def blocks(table: Table, width: int) -> list[list[Column]]:
    """The columns, as many to a block as fit; the first block has ranks and costs beside the metrics."""
    left = _width([table.head, *table.methods, *(name for name, _ in table.feet)])
    room = width - left + GAP  # behind the last column there need be no gap
    return folded(table, room, _width, lambda column: _texts(table, column))


def _texts(table: Table, column: Column) -> list[str]:
    """The heading of a column and its cells."""
    if not isinstance(column, Metric):
        return [column.title, *column.texts]
    cells = [*column.cells, *(cell(column) for _, cell in table.feet)]
    return [heading(column), *(c.text + c.signs + "*" * c.best for c in cells), *(c.below for c in cells)]


def _width(cells: Sequence[str]) -> int:
    from rich.cells import cell_len

    return max(map(cell_len, cells)) + GAP


def _one(table: Table, notes: tuple[str, ...], width: int, color: bool) -> str:
    from rich.text import Text

    parts: list[Any] = [Text(table.title, style="bold")]
    for columns in blocks(table, width):
        parts += [_block(table, columns), Text()]
    return _print([*parts, *_dim(notes, width)], color)


def wrapped(notes: Sequence[str], width: int) -> list[str]:
    """Notes as wide as the terminal, each folded into lines that are set in from its second one on."""
    lines = [wrap(note, max(width, NOTES), subsequent_indent="  ", break_long_words=False) for note in notes]
    return ["\n".join(parts) for parts in lines]


def _dim(notes: tuple[str, ...], width: int) -> list:
    from rich.text import Text

    return [Text(note, style="dim") for note in wrapped(notes, width)]


def _block(table: Table, columns: list[Column]) -> RichTable:
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    padding = (0, GAP - 1, 0, 0)  # the box has one blank more
    grid = RichTable(box=box.SIMPLE_HEAD, show_edge=False, padding=padding, pad_edge=False, header_style="")
    grid.add_column(table.head, no_wrap=True)
    for column in columns:
        right = not isinstance(column, Metric) and column.right
        grid.add_column(heading(column), no_wrap=True, justify="right" if right else "left")
    for i, method in enumerate(table.methods):
        grid.add_row(Text(method), *(_cell(column, i) for column in columns))
    for name, cell in table.feet:
        grid.add_row(Text(name, style="dim"), *(_score(cell(column), "dim") for column in columns))
    return grid


def _cell(column: Column, i: int) -> Text | str:
    return _score(column.cells[i]) if isinstance(column, Metric) else column.texts[i]


def _score(cell: Cell, plain: str = "") -> Text:
    from rich.text import Text

    # The star repeats the bold letters for files, and for readers who do not see bold.
    style = "bold" if cell.best else "underline" if cell.second else plain
    text = Text().append(cell.text + ("*" if cell.best else ""), style=style)  # not of the blanks up to the next column
    text.append(cell.signs)
    return text.append(f"\n{cell.below}", style="dim") if cell.below else text


def remarks(
    board: pd.DataFrame, rows: pd.DataFrame, color: bool = False, names: Mapping[str, str] | None = None
) -> str:
    """The failures and notes in the groups of a board: the count and the first message of each kind.

    Empty if there is nothing.
    """
    from rich.text import Text

    from ..leaderboard import failures, notes

    contenders = set(board[[*GROUP, *CONTENDER]].itertuples(index=False, name=None))
    lines = board[[*GROUP, *CONTENDER, "metric"]]
    setups = {group: shown_setup(part.to_dict("records")) for group, part in lines.groupby(GROUP)}
    called = {
        group: naming(zip(part["method"], part["variant"], strict=True), names).labels
        for group, part in lines.groupby(GROUP)
    }
    parts = []
    for caption, told in (("Not solved", failures(rows)), ("Solved, with a note", notes(rows))):
        several = told.duplicated([*GROUP, *CONTENDER], keep=False)  # messages: which case is each of?
        found = [
            (line, named)
            for line, named in zip(told.to_dict("records"), several, strict=True)
            if tuple(line[c] for c in [*GROUP, *CONTENDER]) in contenders
        ]
        groups = [tuple(line[name] for name in GROUP) for line, _ in found]
        who = [
            with_setup(called[group][line["method"], line["variant"]], setup(line, setups[group]))
            for group, (line, _) in zip(groups, found, strict=True)
        ]
        lines = [_remark(line, name, named) for name, (line, named) in zip(who, found, strict=True)]
        lines, more = lines[:MOST_REMARKS], len(lines) - MOST_REMARKS
        others = f"  and {counted(more, 'other message')}; the rows of the results have them all"
        lines += [Text(others)] if more > 0 else []
        parts += [Text(f"\n{caption}", style="bold"), *lines] if lines else []
    return _print(parts, color) if parts else ""


def _remark(told: dict[str, Any], who: str, name_case: bool) -> Text:
    """One line about failures or notes."""
    from rich.text import Text

    message = one_line(" ".join(str(told["message"] or "").split()))
    message = message if len(message) <= MOST_MESSAGE else message[: MOST_MESSAGE - 1] + "…"
    case = one_line(str(told["case"]))
    message = f"{case}: {message}" if message and name_case and case not in message else message
    where = title_of(*(told[name] for name in GROUP))
    what = "" if told["status"] == "ok" else f" {told['status']}"
    return Text(f"  {who}: {told['count']}{what} ({where}){': ' + message if message else ''}")


def _print(parts: list, color: bool) -> str:
    from rich.console import Console

    out = io.StringIO()
    # Wider than anything: the blocks were made to fit, and a longer line must wrap rather than vanish.
    console = Console(file=out, width=10_000, force_terminal=color, highlight=False, markup=False, emoji=False)
    for part in parts:
        console.print(part, soft_wrap=True)
    return "".join(line.rstrip() + "\n" for line in out.getvalue().splitlines())
