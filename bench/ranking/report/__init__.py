"""How leaderboards are printed: terminal, Markdown, LaTeX, CSV.

::

    print(render(board, "markdown", rows=rows))
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...errors import UsageError, did_you_mean

if TYPE_CHECKING:
    import pandas as pd

    from ..conventions import Convention
    from ..published import Published
    from .look import Look
    from .table import Table

FORMATS = ("terminal", "markdown", "latex", "csv")


def check_format(format: str) -> None:
    """Raise :class:`UsageError` unless it is one of :data:`FORMATS`."""
    if format not in FORMATS:
        raise UsageError(f"format {format!r} is unknown. {did_you_mean(format, FORMATS)}")


def render(
    board: pd.DataFrame,
    format: str = "terminal",
    *,
    rows: pd.DataFrame | None = None,
    metrics: Sequence[str] = (),
    width: int = 120,
    color: bool = False,
    convention: Convention | None = None,
    published: Published | None = None,
    look: Look | None = None,
) -> str:
    """A leaderboard as text.

    Parameters
    ----------
    board : DataFrame
        From :func:`bench.ranking.leaderboard.leaderboard`.
    format : str
        One of :data:`FORMATS`. ``csv`` is the board itself, in full precision; the others are tables to be read.
    rows : DataFrame, optional
        The rows that the board was made from: with them the tables show the number of parameters, and the
        terminal lists what failed.
    metrics : sequence of str
        The order of the metrics; the first one orders the methods. Default: measured distances first.
    width : int
        Columns of the terminal. Metrics that do not fit go into further blocks; nothing is cut off.
    color : bool
        Whether to use bold and dim text on the terminal.
    convention : Convention, optional
        Print a paper's columns, in its units and under its titles, instead of the scores.
    published : Published, optional
        Print the numbers of a paper's table beside ours.
    look : Look, optional
        The columns and their order, names of methods, format of numbers; ``csv`` ignores it.

    Raises
    ------
    UsageError
        For an unknown format, or a column that does not exist.
    """
    check_format(format)
    if convention is not None:
        board, metrics = convention.view(board), list(convention.digits)
    from .cells import csv, plain_texts
    from .tables import tables, tier_of

    if format == "csv":
        tiers = [tier_of(line) for line in board[["method", "variant"]].to_dict("records")]
        return csv(board.assign(tier=tiers) if any(tiers) else board)
    from .look import Look

    look = look or Look()
    board, rows = plain_texts(board), None if rows is None else plain_texts(rows)
    made = tables(board, rows, metrics, convention, published, look)
    if format == "terminal":
        from .terminal import remarks, terminal

        text = terminal(made, width, color)
        return text + (remarks(board, rows, color, look.names) if rows is not None else "")
    return in_format(made, format, look)


def in_format(made: list[Table], format: str, look: Look, width: int = 120, color: bool = False) -> str:
    """Tables as text for a terminal, in Markdown or in LaTeX."""
    if format == "terminal":
        from .terminal import terminal

        return terminal(made, width, color)
    if format == "markdown":
        from .markdown import markdown

        return markdown(made)
    from .latex import latex

    return latex(made, look)
