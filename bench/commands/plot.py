"""A plot of scores for a paper, with its numbers beside it: plot.pdf and plot.csv.

  detailbench plot bars DIR -o bars.pdf --metric p2f_mean                the mean of each method, with its interval
  detailbench plot pareto DIR -o pareto.pdf --cost peak_mb               quality against time or memory, and the front
  detailbench plot noise DIR -o noise.pdf --x sensor.noise               a metric against a parameter that was swept
  detailbench plot time DIR -o time.pdf                                  error against time, from traces and results
  detailbench plot difference DIR -o ranks.pdf                           average ranks and their critical difference
  detailbench plot wins DIR -o wins.pdf                                  how often the row is better than the column
  detailbench plot profile DIR -o profile.pdf --names poisson=Poisson    cases within a factor of the best

All cases, datasets and sensors that the options select are one table, as in `detailbench leaderboard --by task`, with
the same means, intervals and scores of failures. The CSV file has every number that is drawn. Colours are those of
Okabe and Ito; markers and lines differ too. Fonts are embedded as text. docs/figures.md shows all kinds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ..cli import add_plugin_argument
from ..errors import UsageError
from ..pictures.plots.kinds import KINDS
from ..plugins.registry import load_plugins
from .figure import add_shared_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("kind", metavar="KIND", choices=list(KINDS), help=f"one of {', '.join(KINDS)}")
    add_shared_arguments(parser, "plot.pdf")
    parser.add_argument("--metric", metavar="NAME", help="what is shown (default: the one that ranks the task)")
    parser.add_argument("--tag", metavar="NAMES", help="only these tags: one, or several with commas")
    parser.add_argument("--x", metavar="NAME", help="of noise: sensor.noise, method.depth, input.points, ...")
    parser.add_argument("--cost", choices=("seconds", "peak_mb"), default="seconds", help="of pareto")
    parser.add_argument("--by", metavar="WORD", help="of bars: side by side for each dataset, sensor or tag")
    parser.add_argument("--log", action="store_true", help="of noise: a logarithmic scale of the metric")
    parser.add_argument("--level", type=float, default=0.95, help="of intervals and tests (default: 0.95)")
    parser.add_argument("--height", metavar="HEIGHT", help="a length like 2.4in or 60mm (default: by the kind)")
    add_plugin_argument(parser)


OF_ONE_KIND = {"x": "noise", "by": "bars", "log": "noise"}


def run(args: argparse.Namespace) -> int:
    """Draw the plot, write it and its numbers."""
    from ..pictures.plots.kinds import Options, plot
    from ..pictures.plots.scores import scores_of
    from ..pictures.printing import kind_of, matplotlib, saved, width_of
    from ..results.files import write_atomically
    from ..results.store import Results
    from .leaderboard import read_rows

    for name, kind in OF_ONE_KIND.items():
        if getattr(args, name) and args.kind != kind:
            raise UsageError(f"--{name}: is an option of `detailbench plot {kind}`, not of {args.kind}")
    kind = kind_of(args.output)
    size = width_of(args.width or "column"), width_of(args.height, "--height") if args.height else None
    matplotlib()  # reported before anything is read, if it is missing
    load_plugins(args.plugin)
    folders = [word.removeprefix("results=") for word in args.results or ["results"]]
    rows, opened = read_rows(folders), [Results(folder) for folder in folders]
    filters = {name: getattr(args, name) for name in ("task", "dataset", "sensor", "split", "tag")}
    scores = scores_of(
        rows, opened, metric=args.metric, method=args.method, names=args.names, level=args.level, **filters
    )
    made = plot(args.kind, scores, Options(x=args.x, cost=args.cost, by=args.by, size=size, log=args.log))
    target = Path(args.output).expanduser()
    numbers = target.with_suffix(".csv")
    write_atomically(numbers, made.table.to_csv(index=False, lineterminator="\n").encode())
    write_atomically(target, saved(made.figure, kind, 300))
    print(f"{args.output}: {KINDS[args.kind]}, by {scores.metric}; {numbers}: {len(made.table)} rows of numbers")
    for note in made.notes:
        print(note)
    return 0
