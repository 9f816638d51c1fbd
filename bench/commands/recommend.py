"""Rank reconstruction methods for a scan, without ground truth.

  detailbench recommend scan.ply
  detailbench recommend scan1.ply scan2.ply --points 20000
  detailbench recommend scan.ply --methods 'poisson,poisson[depth=6],apss' --json

Each method reconstructs two random halves of the scan separately, in a child process with limits. Each mesh is compared
with the held-out half, the mesh of the other half, and the meshes of the other methods: docs/recommend.md says how, and
how often this agrees with ground truth. Methods with a rank like 1-3 are tied.
Several scans are ranked together: one answer for all of them.
"""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from ..cli import add_plugin_argument
from ..errors import UsageError
from ..plugins.registry import load_plugins

if TYPE_CHECKING:
    from ..recommend.scan import Scan
    from ..recommend.trials import Setup

POINTS = 6000
SECONDS = 30.0
LEAST_POINTS = 200


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("scans", nargs="+", metavar="SCAN", help="point clouds, as `detailbench apply` reads them")
    parser.add_argument("--methods", metavar="A,B[key=value],...", help="methods to choose from (docs/recommend.md)")
    parser.add_argument("--task", default="reconstruct", choices=["reconstruct"], help="the task of the methods")
    tried = f"number of random points of each scan; 0: all (default: {POINTS:,})"
    parser.add_argument("--points", type=int, default=POINTS, metavar="N", help=tried)
    limit = f"time limit for one method on half of those points (default: {SECONDS:g})"
    parser.add_argument("--limit", type=float, default=SECONDS, metavar="SECONDS", help=limit)
    parser.add_argument("--memory", type=float, metavar="GB", help="memory limit for one method (default: 4)")
    parser.add_argument(
        "--jobs", type=int, default=0, metavar="N", help="methods that run in parallel (default: 2 at most)"
    )
    normals = "use the normals of the file, or ignore them (default: file)"
    parser.add_argument("--normals", default="file", choices=["file", "estimate"], help=normals)
    parser.add_argument("--seed", type=int, default=0, help="seed of the halves and the samples (default: 0)")
    parser.add_argument("--json", action="store_true", help="print JSON, in full precision")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Read, try, rank, print."""
    from ..notices import collected
    from ..recommend.candidates import DEFAULT, candidates
    from ..recommend.recommendation import as_json, recommend
    from ..recommend.table import table
    from ..sweep.progress import Steps

    plugins = load_plugins(args.plugin)
    _check(args)
    chosen = candidates(args.methods or DEFAULT, args.task)
    with collected() as notices:
        scans = [_read(path, args) for path in dict.fromkeys(args.scans)]
    for text in notices:
        print(f"note: {text}", file=sys.stderr)
    setup = _setup(args, plugins)
    with Steps(f"{len(chosen)} methods, {len(scans)} {'scan' if len(scans) == 1 else 'scans'}") as steps:

        def ended(done: int, total: int) -> None:
            steps.event({"event": "progress", "done": done, "total": total})

        found = recommend(scans, chosen, setup, ended)
    print(json.dumps(as_json(found), indent=2) if args.json else table(found))
    return 0


def _check(args: argparse.Namespace) -> None:
    if args.points and args.points < LEAST_POINTS:
        raise UsageError(f"--points {args.points}: expected 0 for all, or at least {LEAST_POINTS}")
    if not args.limit > 0:
        raise UsageError(f"--limit {args.limit:g}: expected seconds above 0")
    if args.memory is not None and not args.memory > 0:
        raise UsageError(f"--memory {args.memory:g}: expected gigabytes above 0")
    if args.jobs < 0:
        raise UsageError(f"--jobs {args.jobs}: expected at least 1, or 0 for the default")
    if args.seed < 0:
        raise UsageError(f"--seed {args.seed}: expected at least 0")


def _setup(args: argparse.Namespace, plugins: tuple[str, ...]) -> Setup:
    from ..engine.affinity import available
    from ..plan.limits import Limits
    from ..recommend.trials import Setup

    limit = Limits(seconds=args.limit, **({} if args.memory is None else {"memory_gb": args.memory}))
    return Setup(args.task, args.seed, limit, args.jobs or min(2, len(available())), plugins)


def _read(path: str, args: argparse.Namespace) -> Scan:
    from ..geometry.cloud import PointCloud
    from ..plan.choice import Choice
    from ..recommend.scan import scan_of

    inputs, frame = Choice.of("task", {"_name_": args.task}).build().read([path])
    cloud = inputs["cloud"]
    if args.normals == "estimate":
        cloud = PointCloud(cloud.points)
    return scan_of(path, cloud, frame, args.points, args.seed)
