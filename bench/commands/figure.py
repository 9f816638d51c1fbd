"""A figure of saved outputs for a paper: cases in rows; the input, each method and the reference in columns.

  detailbench figure DIR -o figure.pdf --dataset bumps,cad --method poisson,apss
  detailbench figure DIR -o figure.pdf --case 0,1 --names poisson=Poisson,mine=Ours --metric p2f_mean --width page
  detailbench figure DIR -o figure.png --case menger --limit 0.01 --zoom 0.2,-0.5,0.3,0.15 --camera 30,20
  detailbench figure DIR -o column.pdf --method apss,rimls --width column --no-insets --mesh-edges
  detailbench figure DIR --recompute                          where a run saved no outputs

Shows the outputs that a run with outputs=all (or first) saved, or that --recompute makes again, coloured by the
distance of each vertex to the reference, in radii of the reference, with one scale for all; the tile of a failure
shows its message. All tiles of a row have the same camera. Insets show the place where the methods differ most. Text
in PDF and SVG is text; tiles are pictures of 300 dots per inch. Order: as the options name datasets, sensors, cases
and methods. --recompute uses the seed, parameters and limits of the records, and changes no results.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from ..cli import add_plugin_argument
from ..errors import UsageError
from ..plugins.registry import load_plugins

if TYPE_CHECKING:
    from ..pictures.sheet import Sheet


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_shared_arguments(parser, "figure.pdf")
    parser.add_argument("--case", metavar="CASES", help="numbers, or parts of names, with commas (default: 0)")
    parser.add_argument("--seed", type=int, metavar="N", help="show the outputs of this seed (default: the smallest)")
    parser.add_argument("--metric", metavar="NAMES", help="scores beneath each tile; the best of a row is bold")
    parser.add_argument("--limit", type=float, metavar="RADII", help="distance at the end of the colour scale")
    parser.add_argument("--camera", metavar="AZ,EL[,ZOOM]", help="degrees around and above (default: -52,24)")
    parser.add_argument("--up", choices=("x", "y", "z"), default="z", help="which axis points upward (default: z)")
    parser.add_argument("--zoom", metavar="X,Y,Z,R", help="what the insets show (default: where methods differ most)")
    parser.add_argument("--no-insets", action="store_true", help="without insets")
    parser.add_argument("--mesh-edges", action="store_true", help="draw the edges of meshes")
    parser.add_argument("--surfaces", action="store_true", help="draw clouds as their screened Poisson surface")
    parser.add_argument(
        "--size", type=int, metavar="PIXELS", help="width of a tile (default: 300 per inch of the width)"
    )
    parser.add_argument(
        "--recompute",
        action="store_true",
        help="run cases again whose outputs are not saved; the results do not change",
    )
    parser.add_argument(
        "--allow-program", action="store_true", help="with --recompute: start the programs that records name"
    )
    add_plugin_argument(parser)


def add_shared_arguments(parser: argparse.ArgumentParser, output: str) -> None:
    """The options common to figures and plots."""
    parser.add_argument("results", nargs="*", metavar="RESULTS", help="folders of results (default: results)")
    parser.add_argument(
        "-o", "--output", metavar="FILE", default=output, help=f"a .pdf, .svg or .png file (default: {output})"
    )
    for name in ("task", "dataset", "sensor", "split", "method"):
        parser.add_argument(f"--{name}", metavar="NAMES", help=f"only these {name}s: one, or several with commas")
    parser.add_argument(
        "--names", metavar="NAME=TITLE,...", help="names of methods in the figure: poisson=Poisson,mine=Ours"
    )
    parser.add_argument("--width", metavar="WIDTH", help="column (3.3in), page (7in), or a length like 84mm")


def run(args: argparse.Namespace) -> int:
    """Draw the figure, and report what it shows."""
    from ..pictures.camera import Camera
    from ..pictures.chosen import chosen, renamed, split_names
    from ..pictures.figure import Options, check_metrics, draw
    from ..pictures.printing import kind_of, matplotlib, width_of
    from ..pictures.sheet import Layout
    from ..pictures.tiles import pyvista
    from ..pictures.zoom import zoom_of
    from ..results.files import write_atomically
    from ..results.store import Results
    from .figure_again import recomputed
    from .leaderboard import read_rows

    kind, width = kind_of(args.output), width_of(args.width or "page")
    if args.limit is not None and not (args.limit > 0 and math.isfinite(args.limit)):
        raise UsageError(f"--limit {args.limit:g}: expected a distance above 0, in radii of the reference")
    if args.size is not None and not 32 <= args.size <= 4000:
        raise UsageError(f"--size {args.size}: expected 32 to 4000 pixels")
    if args.zoom and args.no_insets:
        raise UsageError("--zoom sets what the insets show, and --no-insets leaves them out: choose one")
    matplotlib(), pyvista()  # a missing one is reported before anything is read
    camera, zoom = Camera.of(args.camera, args.up), zoom_of(args.zoom) if args.zoom else None
    load_plugins(args.plugin)
    folders = [word.removeprefix("results=") for word in args.results or ["results"]]
    rows, opened = read_rows(folders), [Results(folder) for folder in folders]
    filters = {name: getattr(args, name) for name in ("task", "dataset", "sensor", "split", "method", "case", "seed")}
    rows = chosen(rows, opened, **filters)
    metrics = tuple(split_names(args.metric))
    check_metrics(metrics, rows)
    options = Options(
        camera=camera,
        names=renamed(args.names, list(dict.fromkeys(rows["label"]))),
        metrics=metrics,
        limit=args.limit,
        insets=not args.no_insets,
        zoom=zoom,
        edges=args.mesh_edges,
        surfaces=args.surfaces,
    )
    with tempfile.TemporaryDirectory(prefix="detailbench-") as temporary:
        if args.recompute:
            how = {"plugins": args.plugin, "allow_program": args.allow_program}
            rows, opened = recomputed(rows, opened, Path(temporary), **how)
        sheet = draw(rows, opened, options, Layout(width=width, size=args.size))
    write_atomically(Path(args.output).expanduser(), sheet.save(kind))
    print("\n".join(said(sheet, args.output)))
    return 0


def said(sheet: Sheet, output: str) -> list[str]:
    """What is on a figure: its limit, its insets, and what could not be shown."""
    lines = [f"{output}: {len(sheet.rows)} x {len(sheet.titles)} tiles, {sheet.layout.width:g} inches wide"]
    if sheet.limit > 0:
        lines.append(f"colours end at {sheet.limit:g} {sheet.unit}: --limit {sheet.limit:g}")
    for name, zoom, tiles in zip(sheet.rows, sheet.zooms, sheet.tiles, strict=True):
        name = " ".join(name.split("\n"))
        if zoom is not None:
            place = ",".join(f"{x:.3g}" for x in (*zoom.center, zoom.radius))
            lines.append(f"{name}: insets show --zoom {place}")
        notes = [(title, tile.note) for title, tile in zip(sheet.titles, tiles, strict=True) if tile.note]
        lines += [f"{name}, {title}: {note}" for title, note in notes]
    return lines
