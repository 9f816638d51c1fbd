"""Compare two results, old and new: what got significantly worse, what failed, what is slower. A gate for CI.

  detailbench compare baseline results                       exit code 3 if something is significantly worse (over 2 %)
  detailbench compare baseline results --fail-worse 5% --metric chamfer_l1_mean,p2f_mean
  detailbench compare baseline results --fail-slower 20%     and if a method is significantly slower (over 20 %)
  detailbench compare baseline results --format markdown >> "$GITHUB_STEP_SUMMARY"

A and B are results folders of `detailbench run`, A the older one. Their cases are paired by dataset, sensor, seed,
case and method with its parameters. For each method and metric the mean relative difference over shapes is tested
against the threshold, and the tests are corrected for their number (Holm): many methods and metrics do not make false
alarms. Seconds are divided by the time of a fixed workload that ran just before each call.

Exit code 3 where a line is significantly worse than --fail-worse, where a case fails that was solved, or, with
--fail-slower, where a method is significantly slower; with --fail-gone also where cases are missing. docs/compare.md
has a recipe for CI.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from typing import TYPE_CHECKING

from ..cli import add_plugin_argument
from ..errors import UsageError
from ..plugins.registry import load_plugins

if TYPE_CHECKING:
    from ..ranking.compared import Compared

FORMATS = ("terminal", "markdown", "csv")  # of bench.ranking.report.compared, which imports pandas
FILTERS = ("task", "dataset", "sensor", "method", "tag", "split")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("then", metavar="A", help="the results to compare with, a folder: the baseline")
    parser.add_argument("now", metavar="B", help="the results to judge, a folder")
    for name in (*FILTERS[:4], "metric", *FILTERS[4:]):
        parser.add_argument(f"--{name}", metavar="NAMES", help=f"only these {name}s: one, or several with commas")
    parser.add_argument(
        "--fail-worse", metavar="SHARE", default="2%", help="loss of quality that fails: 2%% or 0.02 (default: 2%%)"
    )
    parser.add_argument("--fail-slower", metavar="SHARE", help="loss of speed that fails (default: no limit)")
    parser.add_argument(
        "--most-failed",
        type=int,
        default=0,
        metavar="N",
        help="number of new failed cases that is allowed (default: 0)",
    )
    parser.add_argument("--fail-gone", action="store_true", help="fail where B lacks cases that A has")
    parser.add_argument("--level", type=float, default=0.95, help="of intervals and of the tests (default: 0.95)")
    parser.add_argument("--full", action="store_true", help="also show lines without a change, and all cases")
    parser.add_argument("--format", choices=FORMATS, default="terminal", help="how to print (default: terminal)")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Compare, print, and judge with the exit code."""
    from ..ranking.compared import compared
    from ..ranking.report.compared import render_compared
    from .leaderboard import read_rows

    if args.plugin:
        load_plugins(args.plugin)
    if not 0 < args.level < 1:
        raise UsageError(f"--level {args.level}: expected a number between 0 and 1")
    if args.most_failed < 0:
        raise UsageError(f"--most-failed {args.most_failed}: expected at least 0")
    worse = share("--fail-worse", args.fail_worse)
    slower = None if args.fail_slower is None else share("--fail-slower", args.fail_slower)
    found = compared(
        read_rows([args.then]),
        read_rows([args.now]),
        metric=args.metric,
        worse=worse,
        slower=slower,
        level=args.level,
        **{name: getattr(args, name) for name in FILTERS},
    )
    for line in other_questions(args.then, args.now, found):
        print(f"warning: the settings differ: {line}", file=sys.stderr)
    width = shutil.get_terminal_size((120, 24)).columns if sys.stdout.isatty() else 160
    print(render_compared(found, args.format, full=args.full, width=width).rstrip("\n"))
    reasons = reasons_to_fail(found, speed=slower is not None, most_failed=args.most_failed, gone=args.fail_gone)
    for line in reasons:
        print(f"worse: {line}", file=sys.stderr)
    if not reasons:
        print("nothing is significantly worse", file=sys.stderr)
    return 3 if reasons else 0


def share(option: str, text: str) -> float:
    """``2%`` or ``0.02``.

    Raises
    ------
    UsageError
        For anything but a share of at least 0.
    """
    number, percent = (text[:-1], 100.0) if text.endswith("%") else (text, 1.0)
    try:
        value = float(number) / percent
    except ValueError:
        value = -1.0
    if not 0 <= value < 10:
        raise UsageError(f"{option} {text}: expected a share such as 2% or 0.02")
    return value


# Causes of a changed score other than the method; the state that a dataset reports is listed as "file".
QUESTION = ("source of task", "source of dataset", "source of sensor", "version of metric", "file ")


def other_questions(then: str, now: str, found: Compared) -> list[str]:
    """Differences in cases and metrics between two results, which change scores regardless of the method."""
    from ..results.provenance import explain
    from ..results.store import Results

    lines: dict[str, None] = {}
    stores = [Results(folder.removeprefix("results=")) for folder in (then, now)]
    for cell_then, mark_then, cell_now, mark_now in found.changed:
        metas = stores[0].meta(cell_then, mark_then), stores[1].meta(cell_now, mark_now)
        parts = (meta.get("ingredients") or {} for meta in metas)
        lines |= dict.fromkeys(line for line in explain(*parts) if line.startswith(QUESTION))
    return list(lines)


def reasons_to_fail(found: Compared, *, speed: bool, most_failed: int, gone: bool) -> list[str]:
    """Reasons why the gate fails, a line each; empty if it passes."""
    from ..ranking.report.labels import label

    lines = [
        f"{label(line['method'], line['variant'])}: {line['metric']} by {100 * line['change']:.1f} %"
        for line in found.quality[found.quality["verdict"] == "worse"].to_dict("records")
    ]
    if speed:
        lines += [
            f"{label(line['method'], line['variant'])}: slower by {100 * (line['ratio'] - 1):.0f} %"
            for line in found.speed[found.speed["verdict"] == "slower"].to_dict("records")
        ]
    if len(found.failed) > most_failed:
        lines.append(f"{len(found.failed)} cases failed that were solved before")
    if gone and len(found.gone):
        lines.append(f"{found.gone['cases'].sum()} cases are missing in the new results")
    return lines
