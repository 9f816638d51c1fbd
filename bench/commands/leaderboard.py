"""Rank finished results: who is better, by how much, how surely, at what cost.

  detailbench leaderboard                                  of the folder `results`
  detailbench leaderboard DIR [DIR ...] --task denoise --metric p2f_mean
  detailbench leaderboard DIR --by tag                     who is best on thin sheets, on sharp edges, ...
  detailbench leaderboard DIR --across tag                 the same for one metric, side by side
  detailbench leaderboard DIR --agreement real             do real shapes order the methods as the others do?
  detailbench leaderboard DIR --convention mpu             a paper's columns, in its units
  detailbench leaderboard DIR --published table_4_1        the table of an experiment, the paper's numbers beside ours
  detailbench leaderboard DIR --pareto p2f_mean,seconds    who is on the front of quality and cost
  detailbench leaderboard DIR --format csv > board.csv     markdown, latex and csv besides the terminal

Means have 95 % intervals over shapes, whatever seeds and sensors each was met with; rank 1-2 is the 95 % confidence
interval of the rank. A failed case enters mean and rank with the score of the worst pseudo-method, and solved/planned
stands beside the mean. Train shapes have tables of their own. Below each table stands what it can show: which
differences this many shapes detect, and who is equal for practical purposes. docs/metrics.md has the formulas.

Where one place in a table has several records (of edited sources, of other versions), the one that is current with
today's sources is shown, the newest where none is: `detailbench why CELL` says which.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..cli import add_plugin_argument
from ..errors import UsageError
from ..plugins.registry import load_plugins
from ..ranking.report import FORMATS
from ..text import below

if TYPE_CHECKING:
    import pandas as pd


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("results", nargs="*", metavar="RESULTS", help="folders of results (default: results)")
    for name in ("task", "dataset", "sensor", "method", "metric", "tag"):
        parser.add_argument(f"--{name}", metavar="NAMES", help=f"only these {name}s: one, or several with commas")
    parser.add_argument("--split", metavar="NAMES", help="only test or only train shapes; they are never in one table")
    parser.add_argument(
        "--by", metavar="WORDS", help="one table for each of: dataset, sensor, tag (default: dataset,sensor)"
    )
    parser.add_argument(
        "--across", metavar="WORD", help="one metric side by side in all groups of: dataset, sensor, tag"
    )
    parser.add_argument(
        "--agreement", metavar="DATASETS", help="these datasets and all others side by side, with Kendall's tau"
    )
    parser.add_argument(
        "--pareto", metavar="A,B", help="mark who is on the front of two metrics, or of one and seconds or peak_mb"
    )
    parser.add_argument(
        "--equal", type=float, default=0.02, metavar="SHARE", help="differences below count as equal (default: 0.02)"
    )
    parser.add_argument("--convention", metavar="NAME", help="print the columns of a paper in its units")
    parser.add_argument("--published", metavar="NAME", help="an experiment whose paper's numbers stand beside ours")
    parser.add_argument("--format", choices=FORMATS, default="terminal", help="how to print (default: terminal)")
    parser.add_argument("--level", type=float, default=0.95, help="of the intervals (default: 0.95)")
    parser.add_argument("--no-index", action="store_true", help="read every file, do not use or write the index")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print the board."""
    from ..ranking.resolution import check_region

    if args.plugin:
        load_plugins(args.plugin)
    args.results, conventions = _split_words(args.results)
    args.convention = args.convention or conventions
    if args.published and (args.convention or args.across):
        raise UsageError(f"--published {args.published}: says itself which columns are shown")
    if args.convention and args.metric:
        raise UsageError(f"--metric {args.metric}: the convention {args.convention} says which metrics are shown")
    others = {name: getattr(args, name) for name in ("by", "convention", "pareto") if getattr(args, name)}
    if args.across and others:
        other = next(f"--{name} {value}" for name, value in others.items())
        raise UsageError(f"--across {args.across}: shows one metric in all groups, which does not go with {other}")
    others |= {name: getattr(args, name) for name in ("across", "published") if getattr(args, name)}
    if args.agreement and others:
        other = next(f"--{name} {value}" for name, value in others.items())
        raise UsageError(f"--agreement {args.agreement}: compares two orders, which does not go with {other}")
    if not 0 < args.level < 1:
        raise UsageError(f"--level {args.level}: expected a number between 0 and 1")
    check_region(args.equal)
    rows = read_rows(args.results or ["results"], use_index=not args.no_index)
    filters = {name: getattr(args, name) for name in ("task", "dataset", "sensor", "method", "tag", "split")}
    if args.agreement:
        show_agreement(rows, args.agreement, args.format, metric=args.metric, level=args.level, **filters)
    elif args.across:
        measures = {"metric": args.metric, "level": args.level, "equal": args.equal}
        show_across(rows, args.across, args.format, **measures, **filters)
    else:
        show(
            rows,
            args.format,
            metric=args.metric,
            level=args.level,
            equal=args.equal,
            by=args.by,
            pareto=args.pareto,
            convention=args.convention,
            published=args.published,
            **filters,
        )
    return 0


def _split_words(words: list[str]) -> tuple[list[str], str | None]:
    """Folders, and the NAME of ``convention=NAME`` as `detailbench run` takes it."""
    names = [word.removeprefix("convention=") for word in words if word.startswith("convention=")]
    return [word for word in words if not word.startswith("convention=")], names[-1] if names else None


def read_rows(folders: list[str], *, use_index: bool = True) -> pd.DataFrame:
    """The rows of several results folders together; of several records of one case, the one that counts."""
    from ..results.index import rows as rows_of
    from ..results.store import Results

    opened = [Results(word.removeprefix("results=")) for word in folders]
    for results in opened:
        if not results.folder.is_dir():
            raise UsageError(f"{results.folder}: no such folder; expected results of `detailbench run`")
    rows = rows_of(opened, use_index=use_index)
    for note in (note for results in opened for note in results.damaged):
        print(f"warning: {note}", file=sys.stderr)
    if rows.empty:
        raise UsageError(f"{', '.join(str(Path(f)) for f in folders)}: there are no results yet; see detailbench run")
    return rows


def show(
    rows: pd.DataFrame,
    format: str = "terminal",
    *,
    level: float = 0.95,
    equal: float = 0.02,
    by: str | None = None,
    pareto: str | None = None,
    convention: str | None = None,
    published: str | None = None,
    missing: str = "",
    **filters: str | None,
) -> None:
    """Rank the rows that the filters leave, and print, in the convention of a paper if one is named.

    ``published`` is an experiment whose file gives a paper's numbers; its convention and its groups are taken.
    ``missing`` is a sentence on cells that are not in the table, see :func:`what_is_missing`; CSV has no place for it.
    """
    from ..ranking.conventions import load_convention
    from ..ranking.leaderboard import leaderboard
    from ..ranking.published import load_published
    from ..ranking.selection import matching, metrics_of, pool, select

    table = load_published(published) if published else None
    if table:
        convention, by = table.convention, by or table.by
    paper = load_convention(convention) if convention else None
    chosen = pool(select(rows, **{k: v for k, v in filters.items() if k != "metric"}), by)
    if paper:
        known = metrics_of(rows)
        paper = paper.of(known)
        if (chosen["status"] == "ok").any():  # where nothing is solved nothing has scores, and the board says so
            filters["metric"] = paper.scores(known)
    board = leaderboard(rows, level=level, equal=equal, by=by, pareto=pareto, **filters)
    wanted = matching("metric", filters.get("metric"), metrics_of(chosen)) if filters.get("metric") else ()
    _print(board, format, rows=chosen, metrics=wanted, convention=paper, published=table)
    if missing and format != "csv":
        print(missing)


def what_is_missing(finished: int, planned: int) -> str:
    """What is said below a table that lacks cells of a sweep which ended early; empty where none is missing."""
    if finished >= planned:
        return ""
    rest = planned - finished
    return f"{finished} of {planned} planned cells: the other {rest} are not finished, and not in this table."


def show_across(
    rows: pd.DataFrame,
    across: str,
    format: str = "terminal",
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
    # Of several tasks each has a metric of its own, which comes before the groups.
    known = set(metrics_of(rows))
    columns = sorted(dict.fromkeys(board["metric"]), key=lambda name: name not in known)
    _print(board, format, rows=chosen, metrics=columns)


def show_agreement(
    rows: pd.DataFrame,
    agreement: str,
    format: str = "terminal",
    *,
    metric: str | None = None,
    level: float = 0.95,
    **filters: str | None,
) -> None:
    """Print how the methods stand on some datasets and on all others, and how far the two orders agree."""
    from ..ranking.agreement import agreement as found
    from ..ranking.report.agreement import render_agreement

    text = render_agreement(
        found(rows, agreement, metric=metric, level=level, **filters), format, level=level, width=_width()
    )
    print(text.rstrip("\n"))


def _width() -> int:
    return shutil.get_terminal_size((120, 24)).columns if sys.stdout.isatty() else 160


def _print(board: pd.DataFrame, format: str, **options: Any) -> None:
    from ..ranking.report import render

    color = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    text = render(board, format, width=_width(), color=color, **options).rstrip("\n")
    print(text, file=below(sys.stdout) if color else sys.stdout)  # the escapes of colours are ours
