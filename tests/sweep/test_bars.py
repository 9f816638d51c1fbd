"""The bars of a terminal: rich's own escapes work, those in titles and lines are shown, and markup is text."""

from __future__ import annotations

import contextlib
import io
import sys
from types import SimpleNamespace

from bench.sweep.progress import Bars, Steps
from bench.text import shown_streams

HOSTILE = "\x1b]0;title\x07\x1b[31m[bold]x[/][link=y]:smile:\r"
VISIBLE = r"\x1b]0;title\x07\x1b[31m[bold]x[/][link=y]:smile:\r"


class Terminal(io.StringIO):
    def isatty(self):
        return True


@contextlib.contextmanager
def terminal(monkeypatch):
    """A terminal in place of both streams; pytest sets them anew behind a fixture."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.delenv("NO_COLOR", raising=False)
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(sys, "stdout", Terminal())
    with shown_streams():
        before = sys.stdout, sys.stderr
        yield stream
        assert (sys.stdout, sys.stderr) == before


def test_bars_show_what_others_say(monkeypatch):
    with terminal(monkeypatch) as stream, Bars(3) as bars:
        bars.cell_begins(SimpleNamespace(title=f"cell {HOSTILE}"), 2, 0)
        bars.ended({"kind": "cell", "line": f"line {HOSTILE}", "notes": [f"note {HOSTILE}"]})
        print(f"printed {HOSTILE}", file=sys.stderr)
        print(f"to stdout {HOSTILE}")
        bars._progress.refresh()
        bars.cell_begins(SimpleNamespace(title=f"cell {HOSTILE}"), 2, 0)
        bars._progress.refresh()
    printed = stream.getvalue()
    for where in ("cell", "line", "warning: note", "printed", "to stdout"):
        assert f"{where} {VISIBLE}" in printed.replace("\n", ""), where
    assert "\x1b]0;" not in printed and "\x07" not in printed and "\x1b[31m[" not in printed
    assert "\x1b[2K" in printed  # rich goes back over its bars


def test_the_bar_of_one_call(monkeypatch):
    with terminal(monkeypatch) as stream, Steps(f"method {HOSTILE}") as steps:
        steps.event({"event": "progress", "done": 1, "total": 2})
        steps._progress.refresh()
    printed = stream.getvalue()
    assert f"method {VISIBLE}" in printed and "\x1b]0;" not in printed and "\x1b[2K" in printed
