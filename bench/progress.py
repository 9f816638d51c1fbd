"""Progress: a rich bar where somebody looks, one line per cell elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .plan import Cell
    from .runner import Outcome


def line_of(cell: Cell, outcome: Outcome) -> str:
    """What became of a cell, in one line."""
    rows = outcome.record.rows
    seconds = sum(row["seconds"] or 0.0 for row in rows)
    text = f"{cell.title}: {outcome.record.solved}/{len(rows)} solved"
    if outcome.cached == len(rows):
        return f"{text}, all there already"
    there = f", {outcome.cached} there already" if outcome.cached else ""
    there += f", {outcome.for_outputs} run again for the outputs" if outcome.for_outputs else ""
    failed = next((row for row in rows if row["status"] != "ok"), None)
    why = f" ({failed['status']}: {_first_line(failed['message'])})" if failed else ""
    return f"{text} in {seconds:.3g} s{there}{why}"


def _first_line(text: str | None) -> str:
    line = (text or "").strip().splitlines()[0] if (text or "").strip() else "no message"
    return line if len(line) <= 160 else line[:157] + "..."


class Lines:
    """One line per finished cell on stderr."""

    def __init__(self, total: int | None = None):
        self.total, self.done = total, 0

    def cell_begins(self, cell: Cell, planned: int, done: int) -> None:
        """Nothing yet."""

    def event(self, event: Mapping[str, Any]) -> None:
        """Nothing: lines are for finished cells."""

    def cell_ends(self, cell: Cell, outcome: Outcome) -> None:
        """The line."""
        self.done += 1
        count = f"[{self.done}/{self.total}] " if self.total else ""
        for note in outcome.notes:
            print(f"warning: {note}", file=sys.stderr)
        # One write, so that the lines of processes side by side do not mix.
        sys.stderr.write(f"{count}{line_of(cell, outcome)}\n")
        sys.stderr.flush()


class Bars(Lines):
    """Two live bars on a terminal: cells of the sweep, and cases (or a method's own steps) of the current cell."""

    def __init__(self, total: int | None):
        super().__init__(total=total)
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        self._progress = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        self._cells = self._progress.add_task("cells", total=total)
        self._cases = self._progress.add_task("", total=None, visible=False)
        self._steps = self._progress.add_task("", total=None, visible=False)

    def __enter__(self) -> Bars:
        self._progress.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._progress.stop()

    def cell_begins(self, cell: Cell, planned: int, done: int) -> None:
        """Show the cell's cases."""
        self._progress.reset(self._cases, total=planned, completed=done, visible=True, description=cell.title)

    def event(self, event: Mapping[str, Any]) -> None:
        """Move the bars."""
        kind = event["event"]
        if kind == "kept":
            self._progress.advance(self._cases)
            self._progress.update(self._steps, visible=False)
        elif kind == "cases":
            self._progress.update(self._cases, total=len(event["ids"]))
        elif kind == "progress":
            self._progress.update(
                self._steps, description="  steps", completed=event["done"], total=event["total"], visible=True
            )

    def cell_ends(self, cell: Cell, outcome: Outcome) -> None:
        """The line stays above the bars."""
        self.done += 1
        for note in outcome.notes:
            self._progress.console.print(f"warning: {note}", markup=False, highlight=False)
        self._progress.console.print(line_of(cell, outcome), markup=False, highlight=False)
        self._progress.update(self._cells, completed=self.done)
        self._progress.update(self._cases, visible=False)


Progress = Lines | Bars


class Steps:
    """A bar for one method call, on a terminal."""

    def __init__(self, title: str):
        self._title = title
        self._progress: Any = None

    def __enter__(self) -> Steps:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

            title = TextColumn("{task.description}", markup=False)
            columns = (SpinnerColumn(), title, BarColumn(), TimeElapsedColumn())
            self._progress = Progress(*columns, console=Console(stderr=True), transient=True)
            self._progress.start()
            self._bar = self._progress.add_task(self._title, total=None)
        return self

    def __exit__(self, *exception: object) -> None:
        if self._progress:
            self._progress.stop()

    def event(self, event: Mapping[str, Any]) -> None:
        """Move the bar."""
        if self._progress and event["event"] == "progress":
            self._progress.update(self._bar, completed=event["done"], total=event["total"])
