"""Rank finished results: which method is better, by how much, with what confidence, at what cost.

  detailbench leaderboard                                  of the folder `results`
  detailbench leaderboard DIR [DIR ...] --task denoise --metric p2f_mean
  detailbench leaderboard DIR --by tag                     which is best on thin sheets, on sharp edges, ...
  detailbench leaderboard DIR --by case                    one line for each shape, one column for each method
  detailbench leaderboard DIR --across tag                 the same for one metric, side by side
  detailbench leaderboard DIR --agreement real             do real shapes order the methods as the others do?
  detailbench leaderboard DIR --convention mpu             a paper's columns, in its units
  detailbench leaderboard DIR --published table_4_1        the table of an experiment, the paper's numbers beside ours
  detailbench leaderboard DIR --pareto p2f_mean,seconds    the Pareto front of quality and cost
  detailbench leaderboard DIR --best                       which parameters of a method are best, on train shapes
  detailbench leaderboard DIR --format csv -o board.csv    markdown, latex and csv besides the terminal
  detailbench leaderboard DIR --format latex --columns p2f_mean,seconds --names mine=Ours --intervals below

Means have 95 % intervals over shapes, across all their seeds and sensors; rank 1-2 is the 95 % confidence interval of
the rank. A failed case enters mean and rank with the score of the worst pseudo-method, and solved/planned stands
beside the mean. Train shapes have tables of their own. Below each table are the smallest differences that its shapes
can detect, and the methods that are equal for practical purposes. docs/metrics.md has the formulas.

Where one cell has several records (of edited sources, of other versions), the table shows the one that is current with
today's sources, or the newest if none is: `detailbench why CELL` says which.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..cli import warn_of_damaged
from ..errors import StoreError, UsageError
from ..plugins.registry import load_plugins
from ..ranking.report.look import Look
from ..text import below
from .leaderboard_options import add_arguments, check, is_by_case, look_of

__all__ = ["add_arguments", "run"]

if TYPE_CHECKING:
    import pandas as pd

    from ..ranking.selection import Names


def run(args: argparse.Namespace) -> int:
    """Print the board, or write it to a file."""
    if args.plugin:
        load_plugins(args.plugin)
    args.results, conventions = _split_words(args.results)
    args.convention = args.convention or conventions
    check(args)
    look = look_of(args)
    folders = args.results or ["results"]
    rows = read_rows(folders, use_index=not args.no_index)
    filters = {name: getattr(args, name) for name in ("task", "dataset", "sensor", "method", "tag", "split")}
    filters |= {"metric": args.metric}
    measures = {"level": args.level, "equal": args.equal}
    output = Output(args.format, look, args.output)
    if args.best:
        from .leaderboard_best import show_best

        show_best(rows, output, preset=args.preset, folders=folders, by=args.by, level=args.level, **filters)
    elif args.agreement:
        show_agreement(rows, args.agreement, output, level=args.level, **filters)
    elif args.across:
        show_across(rows, args.across, output, **measures, **filters)
    elif is_by_case(args):
        show_by_case(rows, args.by, output, **measures, **filters)
    else:
        chosen = {name: getattr(args, name) for name in ("by", "pareto", "convention", "published")}
        show(rows, output, **measures, **chosen, **filters)
    return 0


@dataclass(frozen=True)
class Output:
    """How tables are printed, and where to."""

    format: str = "terminal"
    look: Look = field(default_factory=Look)
    file: str | None = None  # written wholly or not at all; None for the standard output

    @property
    def width(self) -> int:
        """Columns of the terminal."""
        return shutil.get_terminal_size((120, 24)).columns if sys.stdout.isatty() and not self.file else 160

    @property
    def color(self) -> bool:
        """Whether to use bold and dim letters."""
        return not self.file and sys.stdout.isatty() and "NO_COLOR" not in os.environ

    def give(self, text: str) -> None:
        """Print the text, or write the file.

        Raises
        ------
        UsageError
            If it cannot be written.
        """
        text = text.rstrip("\n")
        if not self.file:
            print(text, file=below(sys.stdout) if self.color else sys.stdout)  # the escapes of colours are ours
            return
        from ..results.files import write_atomically

        path = Path(self.file)
        if path.is_dir() or not path.parent.is_dir():
            what = "is a folder" if path.is_dir() else f"there is no folder {path.parent}"
            raise UsageError(f"--output {path}: {what}; expected the name of a file in a folder that is there")
        try:
            write_atomically(path, f"{text}\n".encode("utf-8", "backslashreplace"))
        except StoreError as error:
            raise UsageError(f"--output {path}: cannot be written: {error.__cause__ or error}") from error
        print(f"written to {path}", file=sys.stderr)


def _split_words(words: list[str]) -> tuple[list[str], str | None]:
    """Folders, and the NAME of ``convention=NAME`` as `detailbench run` takes it."""
    names = [word.removeprefix("convention=") for word in words if word.startswith("convention=")]
    return [word for word in words if not word.startswith("convention=")], names[-1] if names else None


def read_rows(folders: list[str], *, use_index: bool = True) -> pd.DataFrame:
    """The rows of several results folders together; of several records of one case, the current or newest."""
    from ..results.index import rows as rows_of
    from ..results.store import Results

    opened = [Results(word.removeprefix("results=")) for word in folders]
    for results in opened:
        if not results.folder.is_dir():
            raise UsageError(f"{results.folder}: no such folder; expected results of `detailbench run`")
    rows = rows_of(opened, use_index=use_index)
    warn_of_damaged(*opened)
    if rows.empty:
        raise UsageError(f"{', '.join(str(Path(f)) for f in folders)}: there are no results yet; see detailbench run")
    return rows


def show(
    rows: pd.DataFrame,
    output: Output | None = None,
    *,
    level: float = 0.95,
    equal: float = 0.02,
    by: str | None = None,
    pareto: str | None = None,
    convention: str | None = None,
    published: str | None = None,
    missing: str = "",
    **filters: Names,
) -> None:
    """Rank the rows that the filters leave, and print, in the convention of a paper if one is named.

    ``published`` is an experiment with a paper's numbers; its convention and groups are used.
    ``missing`` is a sentence on cells that are not in the table, see :func:`what_is_missing`; CSV omits it.
    """
    from ..ranking.conventions import load_convention
    from ..ranking.leaderboard import leaderboard
    from ..ranking.published import load_published
    from ..ranking.selection import matching, metrics_of, pool, select

    output = output or Output()
    table = load_published(published) if published else None
    if table:
        convention, by = table.convention, by or table.by
    paper = load_convention(convention) if convention else None
    chosen = pool(select(rows, **{k: v for k, v in filters.items() if k != "metric"}), by)
    if paper:
        known = metrics_of(rows)
        paper = paper.of(known)
        if (chosen["status"] == "ok").any():  # if nothing is solved there are no scores, and the board reports it
            filters["metric"] = paper.scores(known)
    elif not filters.get("metric"):
        filters["metric"] = _metrics_among(output.look.columns, metrics_of(chosen))
    board = leaderboard(rows, level=level, equal=equal, by=by, pareto=pareto, **filters)
    wanted = matching("metric", filters.get("metric"), metrics_of(chosen)) if filters.get("metric") else ()
    _print(board, output, rows=chosen, metrics=wanted, convention=paper, published=table)
    if missing and output.format != "csv":
        print(missing)


def _metrics_among(columns: Sequence[str], known: Sequence[str]) -> list[str] | None:
    """The metrics among the columns; none if all are shown, or for the front, which uses the task's own two."""
    from ..ranking.report.look import OTHERS
    from ..ranking.selection import matching

    asked = [name for name in columns if name not in OTHERS]
    if not asked or "front" in columns:
        return None
    return matching("columns", asked, [*known, *OTHERS])


def what_is_missing(finished: int, planned: int) -> str:
    """The note below a table that lacks cells of a sweep that ended early; empty if none is missing."""
    if finished >= planned:
        return ""
    return f"{finished} of {planned} planned cells are in this table; the rest is not finished."


def show_across(
    rows: pd.DataFrame,
    across: str,
    output: Output | None = None,
    *,
    level: float = 0.95,
    equal: float = 0.02,
    **filters: str | None,
) -> None:
    """Rank the rows that the filters leave by one metric, and print it for all groups side by side."""
    from ..ranking.overview import overview
    from ..ranking.selection import metrics_of, pool, select

    board = overview(rows, across, level=level, equal=equal, **filters)
    chosen = pool(select(rows, **{k: v for k, v in filters.items() if k != "metric"}), "task")
    # Several tasks have a metric each, which comes before the groups.
    known = set(metrics_of(rows))
    columns = sorted(dict.fromkeys(board["metric"]), key=lambda name: name not in known)
    _print(board, output or Output(), rows=chosen, metrics=columns)


def show_by_case(rows: pd.DataFrame, by: str, output: Output, **options: Any) -> None:
    """Print the scores of each case, methods side by side."""
    from ..ranking.by_case import by_case
    from ..ranking.report import in_format
    from ..ranking.report.case_tables import case_tables
    from ..ranking.report.cells import csv, plain_texts

    scores, board = by_case(rows, by=by, **options)
    _check_names(board, output.look)
    if output.format == "csv":
        output.give(csv(scores))
        return
    made = case_tables(plain_texts(scores), plain_texts(board), output.look)
    output.give(in_format(made, output.format, output.look, output.width, output.color))


def show_agreement(
    rows: pd.DataFrame,
    agreement: str,
    output: Output | None = None,
    *,
    metric: str | None = None,
    level: float = 0.95,
    **filters: str | None,
) -> None:
    """Print the ranking of the methods on some datasets and on all others, and how well the two agree."""
    from ..ranking.agreement import agreement as found
    from ..ranking.report.agreement import render_agreement

    output = output or Output()
    orders = found(rows, agreement, metric=metric, level=level, **filters)
    output.give(render_agreement(orders, output.format, level=level, width=output.width))


def _print(board: pd.DataFrame, output: Output, **options: Any) -> None:
    from ..ranking.report import render

    _check_names(board, output.look)
    output.give(render(board, output.format, width=output.width, color=output.color, look=output.look, **options))


def _check_names(board: pd.DataFrame, look: Look) -> None:
    if look.names:
        from ..ranking.naming import check_names
        from ..ranking.selection import GROUP

        tables = (zip(part["method"], part["variant"], strict=True) for _, part in board.groupby(GROUP))
        check_names(look.names, tables, board["metric"])
