"""From rows to a leaderboard on the screen: what ``detailbench leaderboard`` and the end of ``run`` print."""

from __future__ import annotations

import os
import shutil
import sys
from typing import TYPE_CHECKING, TextIO

from . import render

if TYPE_CHECKING:
    import pandas as pd


def print_board(
    rows: pd.DataFrame, format: str = "terminal", *, metric: str | None = None, stream: TextIO | None = None, **options
) -> None:
    """Rank the rows and print the result.

    Parameters
    ----------
    rows : DataFrame
        One row per planned case.
    format : str
        See :func:`bench.report.render`.
    metric : str, optional
        Metrics with commas; their order is the order of the columns, and the first one orders the methods.
    stream : text file, optional
        Default: standard output. Colour and the width of the window count only where it is a terminal.
    options
        Filters and settings of :func:`bench.leaderboard.leaderboard`.
    """
    from ..leaderboard import FILTERS, leaderboard, matching, metrics_of, select

    rows = select(rows, **{name: options.pop(name, None) for name in FILTERS})
    board = leaderboard(rows, metric=metric, **options)
    order = matching("metric", metric, metrics_of(rows)) if metric is not None else ()
    stream = stream or sys.stdout
    screen = stream.isatty()
    width = shutil.get_terminal_size((120, 24)).columns if screen else 120
    color = screen and not os.environ.get("NO_COLOR")
    stream.write(render(board, format, rows=rows, metrics=order, width=width, color=bool(color)))
