"""Progress: a rich bar on a terminal, one line per cell elsewhere; the same under every launcher."""

from __future__ import annotations

import contextlib
import math
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..text import below, counted, duration, shown, shown_streams
from .forecast import Forecast

if TYPE_CHECKING:
    from ..engine.runner import Outcome
    from ..plan.cell import Cell
    from .session import Session

LOOK = 0.1  # seconds between looks at the entries of jobs
LOOK_AGAIN = 1.0  # seconds for which a forecast is shown unchanged
MOST_LINES = 200  # of cells that were finished before: more are summed up in one line
WORTH_SAYING = 10.0  # seconds left, from which on they are shown


def line_of(cell: Cell, outcome: Outcome) -> str:
    """The outcome of a cell in one line."""
    rows = outcome.record.rows
    seconds = sum(row["seconds"] or 0.0 for row in rows)
    left_out = f" ({cell.left_out})" if cell.left_out else ""
    text = f"{cell.title}: {outcome.record.solved}/{len(rows)} solved{left_out}"
    if outcome.cached == len(rows):
        return f"{text}, all cached"
    there = f", {outcome.cached} cached" if outcome.cached else ""
    there += f", {outcome.for_outputs} run again for the outputs" if outcome.for_outputs else ""
    failed = next((row for row in rows if row["status"] != "ok"), None)
    why = f" ({failed['status']}: {_first_line(failed['message'])})" if failed else ""
    return f"{text} in {seconds:.3g} s{there}{why}"


def _first_line(text: str | None) -> str:
    line = (text or "").strip().splitlines()[0] if (text or "").strip() else "no message"
    return line if len(line) <= 160 else line[:157] + "..."


class Lines:
    """One line per finished job on stderr, in whichever process it was run; see :class:`Follow`."""

    def __init__(self, total: int | None = None, forecast: Forecast | None = None):
        self.total, self.done, self.forecast = total, 0, forecast
        self._left, self._left_at = "", -math.inf

    def cell_begins(self, cell: Cell, planned: int, done: int) -> None:
        """Nothing yet."""

    def event(self, event: Mapping[str, Any]) -> None:
        """Report that a training starts, or that another process runs it; other lines are for finished cells."""
        words = {"train": "begins", "waits": "another process is running it; waiting"}
        if event["event"] in words:
            self.show(f"{event['title']}: {words[event['event']]}")

    def ended(self, entry: Mapping[str, Any]) -> None:
        """Count a job by its entry in its session's folder, and show the line of a cell."""
        if entry["kind"] == "stopped":
            return  # the end of the sweep, which the front door reports
        self.done += 1
        if self.forecast:
            self.forecast.ended(entry.get("job", -1), entry.get("took", 0.0))
        for note in entry.get("notes", ()):
            self.show(f"warning: {note}")
        if "line" in entry:
            count = f"[{self.done}/{self.total}] " if self.total else ""
            left = self.left()
            self.show(f"{count}{entry['line']}{f'; {left}' if left else ''}")

    def ended_before(self, entries: Mapping[int, Mapping[str, Any]]) -> None:
        """Count the jobs that need not be launched: by place in the sweep, the entries that they would leave."""
        for place, entry in entries.items():
            if self.forecast:
                self.forecast.ended(place, 0.0)
            if len(entries) <= MOST_LINES:
                self.ended(entry)
        if len(entries) > MOST_LINES:
            self.done += len(entries)
            cells = sum(entry["kind"] == "cell" for entry in entries.values())
            self.show(f"{counted(cells, 'cell')} of {self.total} finished before, all cached")

    def left(self) -> str:
        """``about 3 min left``; empty if that is not known, or no longer of interest."""
        if self.forecast and time.monotonic() - self._left_at > LOOK_AGAIN:
            seconds = self.forecast.left()
            self._left = f"about {duration(seconds)} left" if seconds and seconds >= WORTH_SAYING else ""
            self._left_at = time.monotonic()
        return self._left

    def show(self, text: str) -> None:
        """One line, in one write."""
        sys.stderr.write(f"{text}\n")
        sys.stderr.flush()


class Bars(Lines):
    """Two live bars on a terminal: cells of the sweep, and cases (or a method's own steps) of the current cell."""

    def __init__(self, total: int | None, forecast: Forecast | None = None):
        super().__init__(total, forecast)
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        self._progress = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=Console(file=below(sys.stderr), emoji=False),
            transient=True,
        )
        self._live = contextlib.ExitStack()
        self._cells = self._progress.add_task("cells", total=total)
        self._cases = self._progress.add_task("", total=None, visible=False)
        self._steps = self._progress.add_task("", total=None, visible=False)

    def __enter__(self) -> Bars:
        self._live.enter_context(self._progress)
        self._live.enter_context(shown_streams())  # rich puts other output above the bars, including escape sequences
        return self

    def __exit__(self, *exception: object) -> None:
        self._live.close()

    def cell_begins(self, cell: Cell, planned: int, done: int) -> None:
        """Show the cell's cases."""
        self._progress.reset(self._cases, total=planned, completed=done, visible=True, description=shown(cell.title))

    def event(self, event: Mapping[str, Any]) -> None:
        """Move the bars."""
        super().event(event)
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

    def ended(self, entry: Mapping[str, Any]) -> None:
        """Move the bar of the cells, too."""
        super().ended(entry)
        left = self.left()
        self._progress.update(self._cells, completed=self.done, description=f"cells, {left}" if left else "cells")
        self._progress.update(self._cases, visible=False)

    def show(self, text: str) -> None:
        """The line stays above the bars."""
        self._progress.console.print(shown(text), markup=False, highlight=False)


Progress = Lines | Bars


class Follow:
    """Shows the entries that the jobs of a session leave in its folder as they appear, whichever process runs them.

    ``places`` are the places of the launched jobs in their sweep, if some are not launched.

    Inside ``with``, a thread checks the folder regularly; at the end all entries have been shown.
    """

    def __init__(self, session: Session, progress: Progress, places: Sequence[int] | None = None):
        self._session, self._progress, self._places = session, progress, places
        self._shown: set[str] = set()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._look_on, daemon=True, name="progress")

    def __enter__(self) -> Follow:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._stop.set()
        self._thread.join()
        self.look()

    def _look_on(self) -> None:
        pause = LOOK
        while not self._stop.wait(pause):
            begin = time.monotonic()
            self.look()
            pause = max(LOOK, 20 * (time.monotonic() - begin))  # tens of thousands of files take a while to list

    def look(self) -> None:
        """Show what is new."""
        for name, entry in self._session.entries(self._shown):
            self._shown.add(name)
            if self._places is not None and entry.get("job", -1) in range(len(self._places)):
                entry["job"] = self._places[entry["job"]]  # jobs are numbered among the launched ones
            self._progress.ended(entry)


class Steps:
    """A bar on a terminal for one method call after the other: the stage and its progress."""

    def __init__(self, title: str):
        self._title, self._doing = title, ""
        self._progress: Any = None
        self._live = contextlib.ExitStack()

    def __enter__(self) -> Steps:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

            title = TextColumn("{task.description}", markup=False)
            columns = (SpinnerColumn(), title, BarColumn(), TimeElapsedColumn())
            self._progress = Progress(*columns, console=Console(file=below(sys.stderr)), transient=True)
            self._live.enter_context(self._progress)
            self._live.enter_context(shown_streams())
            self._bar = self._progress.add_task(shown(self._title), total=None)
        return self

    def __exit__(self, *exception: object) -> None:
        self._live.close()

    def begin(self, title: str) -> None:
        """Start the bar of the next call."""
        self._title, self._doing = title, ""
        if self._progress:
            self._progress.reset(self._bar, total=None, description=shown(title))

    def event(self, event: Mapping[str, Any]) -> None:
        """Move the bar, or show the stage."""
        if not self._progress:
            return
        if event["event"] == "progress":
            self._progress.update(self._bar, completed=event["done"], total=event["total"])
        elif event["event"] == "doing" and event["what"] != self._doing:
            self._doing = event["what"]
            text = shown(f"{self._title}: {self._doing}" if self._doing else self._title)
            self._progress.update(self._bar, description=text, completed=0, total=None)

    def show(self, text: str) -> None:
        """A line that stays, above the bar if there is one."""
        if self._progress:
            self._progress.console.print(shown(text), markup=False, highlight=False)
        else:
            sys.stderr.write(f"{text}\n")
            sys.stderr.flush()
