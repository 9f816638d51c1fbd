"""Tables in GitHub's Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable

from .table import Cell, Metric, Table, shared_notes, standing_notes
from .terminal import heading


def markdown(tables: list[Table]) -> str:
    """One section per table; notes about all of them come last."""
    if not tables:
        return "No results.\n"
    own, shared = shared_notes(tables, *standing_notes(tables, "Bold", "Italic"))
    return "\n".join([*map(_one, tables, own), _list(shared)])


def escape(text: str) -> str:
    """Escape characters that would be markup in a cell, and the bracket before a link or an image."""
    return re.sub(r"([\\|*<`~]|\[(?=.*\][(\[]))", r"\\\1", text)


def _one(table: Table, notes: tuple[str, ...]) -> str:
    columns = table.columns
    lines = [f"### {escape(table.title)}", "", _line(map(escape, [table.head, *map(heading, columns)]))]
    rules = ("--:" if not isinstance(c, Metric) and c.right else "---" for c in columns)
    lines.append(_line(["---", *rules]))
    for i, method in enumerate(table.methods):
        cells = (_score(c.cells[i]) if isinstance(c, Metric) else c.texts[i] for c in columns)
        lines.append(_line([escape(method), *cells]))
    for name, cell in table.feet:
        lines.append(_line([f"*{escape(name)}*", *(_score(cell(column)) for column in columns)]))
    return "\n".join([*lines, "", *([_list(notes)] if notes else [])])


def _score(cell: Cell) -> str:
    text = escape(cell.text)
    if text and (cell.best or cell.second):
        text = f"**{text}**" if cell.best else f"*{text}*"
    below = f"<br>{escape(cell.below)}" if cell.below else ""
    return f"{text}{' ' * cell.tied}{cell.signs}{below}"


def _list(notes: tuple[str, ...]) -> str:
    return "".join(f"- {escape(note)}\n" for note in notes)


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
