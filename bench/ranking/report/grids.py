"""Plain tables with a title and notes, in the formats of the leaderboard but CSV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...text import one_line
from . import latex, markdown
from .table import Cell, Metric, Table
from .terminal import wrapped


@dataclass(frozen=True)
class Grid:
    """A plain table, whose control characters are shown."""

    title: str
    head: tuple[str, ...]
    lines: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "title", one_line(self.title))
        object.__setattr__(self, "head", tuple(map(one_line, self.head)))
        object.__setattr__(self, "lines", tuple(tuple(map(one_line, line)) for line in self.lines))
        object.__setattr__(self, "notes", tuple(map(one_line, self.notes)))


def rendered(grids: Sequence[Grid], format: str, width: int = 120) -> str:
    """Tables one below the other, as ``terminal``, ``markdown`` or ``latex``; ``width`` is that of the terminal."""
    if format == "markdown":
        return "\n".join(map(_markdown, grids))
    if format == "latex":
        return "% needs \\usepackage{booktabs}\n" + "\n".join(map(_latex, grids))
    return "\n".join(_terminal(grid, width) for grid in grids)


def _terminal(grid: Grid, width: int) -> str:
    columns = list(zip(grid.head, *grid.lines, strict=True))
    widths = [max(map(len, column)) for column in columns]

    def line(cells: Sequence[str]) -> str:
        return "  ".join(f"{cell:<{size}}" for cell, size in zip(cells, widths, strict=True)).rstrip()

    rule = "─" * (sum(widths) + 2 * (len(widths) - 1))
    return "\n".join([grid.title, line(grid.head), rule, *map(line, grid.lines), "", *wrapped(grid.notes, width), ""])


def _markdown(grid: Grid) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(map(markdown.escape, cells)) + " |"

    rule = "| " + " | ".join(["---"] * len(grid.head)) + " |"
    notes = [f"- {markdown.escape(note)}" for note in grid.notes]
    title = f"### {markdown.escape(grid.title)}"
    return "\n".join([title, "", line(grid.head), rule, *map(line, grid.lines), "", *notes, ""])


def _latex(grid: Grid) -> str:
    """The grid as a table that fits a column, without the line about the packages it needs."""
    columns = (
        Metric(title, "", 0, tuple(Cell(line[i]) for line in grid.lines), title=title)
        for i, title in enumerate(grid.head)
        if i
    )
    table = Table(
        *(grid.title, "", "", "test"),
        methods=tuple(line[0] for line in grid.lines),
        metrics=tuple(columns),
        notes=grid.notes,
        head=grid.head[0],
    )
    return latex.latex([table]).partition("\n")[2]
