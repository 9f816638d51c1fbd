"""Tables in GitHub's Markdown."""

from __future__ import annotations

import re

from .tables import Table, any_best, shared_notes
from .terminal import heading


def markdown(tables: list[Table]) -> str:
    """One section per table; what is to be noted of all of them comes last."""
    if not tables:
        return "No results.\n"
    own, shared = shared_notes(tables, *(["Bold: tied for first."] if any_best(tables) else []))
    return "\n".join([*map(_one, tables, own), _list(shared)])


def escape(text: str) -> str:
    """Letters that would be markup in a cell, and the bracket before a link or an image."""
    return re.sub(r"([\\|*<`~]|\[(?=.*\][(\[]))", r"\\\1", text)


def _one(table: Table, notes: tuple[str, ...]) -> str:
    places, costs = table.places, table.costs
    head = ["method", *(t for t, _ in places), *map(heading, table.metrics), *(title for title, _ in costs)]
    lines = [f"### {escape(table.title)}", "", _line(map(escape, head))]
    lines.append(_line(["---"] * (1 + len(places) + len(table.metrics)) + ["--:"] * len(costs)))
    for i, method in enumerate(table.methods):
        scores = [_bold(escape(c.text), c.best) + c.mark for c in (m.cells[i] for m in table.metrics)]
        where = [cells[i] for _, cells in places]
        lines.append(_line([escape(method), *where, *scores, *(cells[i] for _, cells in costs)]))
    if any(m.floor for m in table.metrics):
        floors = [m.floor for m in table.metrics]
        lines.append(_line(["*floor / reference*", *("" for _ in places), *floors, *("" for _ in costs)]))
    return "\n".join([*lines, "", *([_list(notes)] if notes else [])])


def _list(notes: tuple[str, ...]) -> str:
    return "".join(f"- {escape(note)}\n" for note in notes)


def _bold(text: str, best: bool) -> str:
    return f"**{text}**" if best and text else text


def _line(cells) -> str:
    return "| " + " | ".join(cells) + " |"
