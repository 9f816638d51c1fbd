"""The worst cases of a method: where it fails or falls behind, what these shapes share, how to see them.

  detailbench worst poisson results/mine
  detailbench worst poisson results/mine --metric normal_angle_deg --sensor noisy --count 5
  detailbench worst idf_30 results/mine --order score              by the score itself, not against the best other
  detailbench worst poisson results/mine --picture worst.png       the three worst, beside the best other method
  detailbench worst poisson results/mine --format csv -o worst.csv

Each case stands beside the best other method on the same case. Below the table are the command that runs a cell again,
the saved output (`detailbench run ... outputs=all`), and the message of a failure. A failed case has the score of the
worst pseudo-method. Tags that are more frequent among the worst quarter of the shapes are listed with a test.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ..cli import COMMANDS, add_plugin_argument, main
from ..errors import UsageError
from ..plugins.registry import load_plugins
from ..ranking.report import FORMATS

if TYPE_CHECKING:
    from ..ranking.worst import Worst

COUNT = 8
PICTURED = 3  # cases of a picture


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("method", metavar="METHOD", help="a method, a preset, or METHOD[parameters] as tables show it")
    parser.add_argument("results", nargs="*", metavar="RESULTS", help="folders of results (default: results)")
    for name in ("task", "dataset", "sensor", "tag", "split"):
        parser.add_argument(f"--{name}", metavar="NAMES", help=f"only these {name}s: one, or several with commas")
    parser.add_argument("--metric", metavar="NAME", help="by which metric (default: the one that ranks the task)")
    order = "by the ratio to the best other method, or by the score (default: ratio)"
    parser.add_argument("--order", choices=("ratio", "score"), default="ratio", help=order)
    parser.add_argument("--count", type=int, default=COUNT, metavar="N", help=f"how many cases (default: {COUNT})")
    parser.add_argument("--format", choices=FORMATS, default="terminal", help="how to print (default: terminal)")
    parser.add_argument("-o", "--output", metavar="FILE", help="write to this file, wholly or not at all")
    picture = f"draw the {PICTURED} worst with `detailbench figure`; their outputs must be saved (outputs=all)"
    parser.add_argument("--picture", metavar="FILE", help=picture)
    parser.add_argument("--no-index", action="store_true", help="read every file, do not use or write the index")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print the cases, and draw them."""
    from ..ranking.report import in_format
    from ..ranking.report.cells import csv, plain_texts
    from ..ranking.report.look import Look
    from ..ranking.report.worst_tables import case_notes, worst_tables
    from ..ranking.worst import commands, outputs, worst
    from .leaderboard import Output, read_rows

    load_plugins(args.plugin)
    if args.count < 1:
        raise UsageError(f"--count {args.count}: expected 1 or more")
    if args.picture and "figure" not in COMMANDS:
        raise UsageError("--picture: this version has no command `figure`, which draws it")
    folders = [folder.removeprefix("results=") for folder in args.results or ["results"]]
    rows = read_rows(folders, use_index=not args.no_index)
    filters = {name: getattr(args, name) for name in ("task", "dataset", "sensor", "tag", "split")}
    found = worst(rows, args.method, metric=args.metric, order=args.order, **filters)
    output, texts = Output(args.format, file=args.output), []
    for one in found:
        shown = one.cases.head(args.count)
        runs, kept = commands(shown, folders), outputs(shown, folders)
        if args.format == "csv":
            texts.append(csv(plain_texts(shown.assign(output=kept, command=runs))))
            continue
        text = in_format(worst_tables(one, args.count), args.format, Look(), output.width, output.color)
        mark = {"markdown": "    ", "latex": "% "}.get(args.format, "")
        notes = [f"{mark}{line}" for line in case_notes(one, args.count, runs, kept)]
        texts.append("\n".join([text.rstrip("\n"), "", *notes, ""]))
    header, *others = texts
    output.give("\n".join([header, *(_without_head(t) if args.format == "csv" else t for t in others)]))
    return draw(found[0], folders, args.picture) if args.picture else 0


def _without_head(text: str) -> str:
    return text.partition("\n")[2]


def draw(found: Worst, folders: list[str], file: str) -> int:
    """The worst cases with the sensor of the worst one, beside the best other method, by `detailbench figure`."""
    first = found.cases.iloc[0]
    same = found.cases[found.cases["sensor"] == first["sensor"]].drop_duplicates(["dataset", "case"]).head(PICTURED)
    best = [name for name in same["best_method"] if isinstance(name, str)]
    options = {
        "task": found.task,
        "split": found.split,
        "dataset": ",".join(dict.fromkeys(same["dataset"])),
        "sensor": first["sensor"],
        "case": ",".join(same["case"]),
        "method": ",".join(dict.fromkeys([found.method, *best[:1]])),
        "metric": found.metric,
    }
    words = [word for name, value in options.items() if value for word in (f"--{name}", value)]
    return main(["figure", *folders, "-o", file, *words])
