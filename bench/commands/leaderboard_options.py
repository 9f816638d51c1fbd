"""The options of `detailbench leaderboard`, which of them exclude each other, and the look they define."""

from __future__ import annotations

import argparse

from ..cli import add_plugin_argument
from ..errors import UsageError
from ..ranking.report import FORMATS
from ..ranking.report.look import GIVEN, INTERVALS, NONE, ORDERS, OTHERS, Look

MOST_DIGITS = 12


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """All options, in groups."""
    parser.add_argument("results", nargs="*", metavar="RESULTS", help="folders of results (default: results)")
    _add_filters(parser.add_argument_group("which results"))
    _add_views(parser.add_argument_group("which table"))
    _add_look(parser.add_argument_group("how it looks"))
    parser.add_argument("--no-index", action="store_true", help="read every file, do not use or write the index")
    add_plugin_argument(parser)


def _add_filters(group: argparse._ArgumentGroup) -> None:
    for name in ("task", "dataset", "sensor", "method", "metric", "tag"):
        group.add_argument(f"--{name}", metavar="NAMES", help=f"only these {name}s: one, or several with commas")
    group.add_argument("--split", metavar="NAMES", help="only test or only train shapes; they are never in one table")


def _add_views(group: argparse._ArgumentGroup) -> None:
    by = "one table for each of: dataset, sensor, tag, or just task (default: dataset,sensor); case: one line a case"
    group.add_argument("--by", metavar="WORDS", help=by)
    across = "one metric side by side in all groups of: dataset, sensor, tag"
    group.add_argument("--across", metavar="WORD", help=across)
    agreement = "these datasets and all others side by side, with Kendall's tau"
    group.add_argument("--agreement", metavar="DATASETS", help=agreement)
    group.add_argument("--best", action="store_true", help="which parameters of a method are best, on train shapes")
    group.add_argument("--preset", metavar="NAME", help="with --best: write the winner to conf/method/NAME.yaml")
    pareto = "mark the Pareto front of two metrics, or of one metric and seconds or peak_mb"
    group.add_argument("--pareto", metavar="A,B", help=pareto)
    equal = "differences below count as equal (default: 0.02)"
    group.add_argument("--equal", type=float, default=0.02, metavar="SHARE", help=equal)
    group.add_argument("--convention", metavar="NAME", help="print the columns of a paper in its units")
    group.add_argument("--published", metavar="NAME", help="show the numbers of an experiment's paper beside ours")
    group.add_argument("--level", type=float, default=0.95, help="confidence level of the intervals (default: 0.95)")


def _add_look(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--format", choices=FORMATS, default="terminal", help="how to print (default: terminal)")
    group.add_argument("-o", "--output", metavar="FILE", help="write to this file, wholly or not at all")
    columns = f"these columns in this order: metrics, and {', '.join(OTHERS)}"
    group.add_argument("--columns", metavar="A,B,...", help=columns)
    names = "names of methods and metrics in the table: poisson=Poisson,mine=Ours"
    group.add_argument("--names", metavar="OLD=NEW,...", help=names)
    order = "methods by their rank, or in the order given by --method (default: rank)"
    group.add_argument("--order", choices=ORDERS, default=ORDERS[0], help=order)
    digits = "decimals of every number (default: what the intervals support, the same within a column)"
    group.add_argument("--digits", type=int, metavar="N", help=digits)
    intervals = "where to print the intervals: in the line, below it, as plusminus half their width, or none"
    group.add_argument("--intervals", choices=INTERVALS, default=INTERVALS[0], help=intervals)
    group.add_argument("--no-intervals", action="store_true", help="the same as --intervals none")
    caption = "replaces the title; in LaTeX, commands are not escaped"
    group.add_argument("--caption", metavar="TEXT", help=caption)
    group.add_argument("--label", metavar="TEXT", help="LaTeX: label of the table, for \\ref")
    group.add_argument("--wide", action="store_true", help="LaTeX: table*, over both columns of a page")
    cite = "LaTeX: \\cite each method, by a key such as kazhdan2013"
    group.add_argument("--cite", action="store_true", help=cite)


def check(args: argparse.Namespace) -> None:
    """Refuse options that do not go together.

    Raises
    ------
    UsageError
        Naming the two.
    """
    from ..ranking.resolution import check_region
    from ..ranking.selection import GROUPINGS, matching

    if args.published and (args.convention or args.across):
        raise UsageError(
            f"--published {args.published}: the experiment chooses the columns; leave out --convention and --across"
        )
    if args.convention and args.metric:
        raise UsageError(
            f"--metric {args.metric}: the convention {args.convention} chooses the metrics; leave one of the two out"
        )
    others = {name: getattr(args, name) for name in ("by", "convention", "pareto") if getattr(args, name)}
    _alone(args, "across", "shows one metric in all groups", others)
    others |= {name: getattr(args, name) for name in ("across", "published") if getattr(args, name)}
    _alone(args, "agreement", "compares two orders", others)
    if args.best:
        for name, value in ({k: v for k, v in others.items() if k != "by"} | {"agreement": args.agreement}).items():
            if value:
                raise UsageError(f"--best: compares the variants of a method, which does not go with --{name} {value}")
    elif args.preset:
        raise UsageError(f"--preset {args.preset}: writes the winner of --best; add --best")
    if args.by:
        matching("by", args.by, (*GROUPINGS, "case"))
    if is_by_case(args):
        not_by = {"pareto": args.pareto, "convention": args.convention, "published": args.published}
        for name, value in (not_by | {"columns": args.columns}).items():
            if value:
                raise UsageError(f"--by {args.by}: has methods as columns, which does not go with --{name} {value}")
    if not 0 < args.level < 1:
        raise UsageError(f"--level {args.level}: expected a number between 0 and 1")
    check_region(args.equal)


def _alone(args: argparse.Namespace, option: str, does: str, others: dict[str, str]) -> None:
    if getattr(args, option) and others:
        other = next(f"--{name} {value}" for name, value in others.items())
        raise UsageError(f"--{option} {getattr(args, option)}: {does}, which does not go with {other}")


def is_by_case(args: argparse.Namespace) -> bool:
    """Whether one line for each case is asked for."""
    from ..ranking.selection import split_names

    return "case" in split_names(args.by)


def look_of(args: argparse.Namespace) -> Look:
    """The look that the options ask for.

    Raises
    ------
    UsageError
        For an invalid value.
    """
    from ..ranking.selection import split_names

    if args.digits is not None and not 0 <= args.digits <= MOST_DIGITS:
        raise UsageError(f"--digits {args.digits}: expected a whole number from 0 to {MOST_DIGITS}")
    if args.order == GIVEN and not args.method:
        raise UsageError("--order given: name the methods in their order with --method A,B,...")
    if args.no_intervals and args.intervals not in (INTERVALS[0], NONE):
        raise UsageError(f"--no-intervals: does not go with --intervals {args.intervals}")
    return Look(
        columns=tuple(split_names(args.columns)),
        names=names_of(args.names),
        digits=args.digits,
        intervals=NONE if args.no_intervals else args.intervals,
        order=args.order,
        methods=tuple(split_names(args.method)),
        caption=args.caption or "",
        label=args.label or "",
        wide=args.wide,
        cite=args.cite,
    )


def names_of(text: str | None) -> dict[str, str]:
    """``poisson=Poisson,idf[omega=30]=Ours`` as a mapping; a comma in a new name is not possible.

    Raises
    ------
    UsageError
        For a part without a new name.
    """
    from ..ranking.selection import split_names

    found = {}
    for part in split_names(text):
        old, equals, new = part.rpartition("=")
        if not equals or not old.strip() or not new.strip():
            raise UsageError(f"--names {part}: expected OLD=NEW, such as poisson=Poisson.")
        found[old.strip()] = new.strip()
    return found
