"""Tables in GitHub's Markdown."""

from __future__ import annotations

import re

from .tables import Table
from .terminal import heading


def markdown(tables: list[Table]) -> str:
    """One section per table."""
    return "\n".join(map(_one, tables)) if tables else "No results.\n"


def escape(text: str) -> str:
    """Letters that would be markup in a cell."""
    return re.sub(r"([\\|*<`~])", r"\\\1", text)


def _one(table: Table) -> str:
    costs = table.costs
    head = ["method", "rank", *map(heading, table.metrics), *(title for title, _ in costs)]
    lines = [f"### {escape(table.title)}", "", _line(map(escape, head))]
    lines.append(_line(["---"] * (2 + len(table.metrics)) + ["--:"] * len(costs)))
    for i, method in enumerate(table.methods):
        scores = [_bold(escape(c.text), c.best) + c.mark for c in (m.cells[i] for m in table.metrics)]
        lines.append(_line([escape(method), table.ranks[i], *scores, *(cells[i] for _, cells in costs)]))
    if any(m.floor for m in table.metrics):
        lines.append(_line(["*floor / reference*", "", *(m.floor for m in table.metrics), *("" for _ in costs)]))
    notes = [f"- {escape(note)}" for note in (*table.notes, "Bold: tied for first.")]
    return "\n".join([*lines, "", *notes, ""])


def _bold(text: str, best: bool) -> str:
    return f"**{text}**" if best and text else text


def _line(cells) -> str:
    return "| " + " | ".join(cells) + " |"
