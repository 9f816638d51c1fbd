"""Score outputs that were made elsewhere, from the inputs that `detailbench inputs` wrote.

  detailbench inputs FOLDER dataset=bumps,cad sensor=noisy
  (your code reads FOLDER/manifest.json, and writes an output for each case)
  detailbench import FOLDER --method my_method results=results
  detailbench import FOLDER --method my_method results=results limit.setup_seconds=600

Each case becomes a row of the results folder, scored by the same metrics as any method, in child processes with limits.
The rows have no time and no memory, and name the method. An output that is missing, damaged, or in other coordinates
is a failed case. Run it again when outputs were added or changed: unchanged outputs are not scored again.

Exit code 0 where every case was solved, 3 where some were not.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import Any

from ..cli import add_plugin_argument
from ..errors import UsageError
from ..plugins.registry import load_plugins
from ..text import counted

PASSES_ON = True
KEYS = ("results", "outputs", "rerun", "verbose")  # of `detailbench run`, which may be given here, and limit.*
PLUGIN = "imported"  # the method that returns the given outputs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("folder", metavar="FOLDER", help="of `detailbench inputs`, with the outputs in it")
    parser.add_argument("--method", metavar="NAME", required=True, help="what the outputs are called in tables")
    parser.add_argument("--no-leaderboard", action="store_true", help="do not print the leaderboard at the end")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Make a cell of each group of the manifest, run those that are not finished, print the leaderboard."""
    from ..engine.runner import forget_servers, run_cell
    from ..results.store import Results
    from .inputs import read_manifest
    from .leaderboard import show

    plugins = load_plugins(args.plugin)
    if not re.fullmatch(r"[\w.+ -]{1,80}", args.method):
        raise UsageError(f"--method {args.method}: expected a name of letters, digits, blanks and ._+-, 80 at most")
    folder = Path(args.folder).expanduser().absolute()
    manifest = read_manifest(folder)
    cells = [cell_of(folder, name, group["cell"], args.method) for name, group in manifest["groups"].items()]
    settings = settings_of(list(args.rest), plugins)
    results = Results(settings.results, mends=True)
    results.prepare()
    solved = planned = cached = 0
    done = set()
    try:
        for cell in cells:
            outcome = run_cell(cell, settings)
            record = outcome.record
            done.add((record.cell, record.fingerprint))
            solved, planned, cached = solved + record.solved, planned + len(record.rows), cached + outcome.cached
            print(f"{cell.title}: {record.solved}/{len(record.rows)} solved", file=sys.stderr)
            for row in record.rows:
                if row["status"] != "ok":
                    print(f"  {row['case']}: {row['status']}: {row['message']}", file=sys.stderr)
    finally:
        forget_servers()
    if not args.no_leaderboard and done:
        show(results.rows(of=done))
    print(
        f"{counted(len(cells), 'cell')}, {solved}/{planned} cases solved, {planned - cached} scored, {cached} cached; "
        f"results in {results.folder}",
        file=sys.stderr,
    )
    return 0 if solved == planned else 3


def cell_of(folder: Path, group: str, values: dict[str, Any], name: str) -> Any:
    """The cell that scores the outputs of one group; everything in it is checked.

    Raises
    ------
    UsageError
        If the manifest names a plugin that is not here, or parameters that it does not have.
    """
    from ..plan.cell import Cell
    from ..plan.choice import NO_SENSOR, Choice
    from ..plugins.schema import NAME_KEY

    parameters = {"name": name, "folder": str(folder), "group": group}
    try:
        cell = Cell.from_json({**values, "method": {"kind": "method", "name": PLUGIN, "parameters": parameters}})
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(
            f"{folder}: the group {group} of the manifest is damaged ({error!r}); write it again"
        ) from error
    for choice in (cell.task, cell.dataset, cell.sensor, cell.method, *cell.metrics):
        if choice != NO_SENSOR:
            Choice.of(choice.kind, {NAME_KEY: choice.name, **choice.parameters})
    if not cell.method.solves(cell.task.name):
        raise UsageError(f"{folder}: the group {group} is of the task {cell.task.name}, whose outputs are no files")
    return cell


def settings_of(words: list[str], plugins: tuple[str, ...]) -> Any:
    """The settings among the overrides, which do not define cells."""
    from dataclasses import replace

    from ..plan.cell import settings_of as composed
    from ..sweep.flags import split_words
    from ..sweep.overrides import checked

    overrides, flags = split_words(words)
    for word in [*flags, *overrides]:
        key = word.partition("=")[0].lstrip("+~")
        if key not in KEYS and not key.startswith("limit."):
            raise UsageError(
                f"{word}: expected {', '.join(f'{k}=' for k in KEYS)} or limit.KEY=; the manifest says the rest"
            )
    return replace(composed(checked(overrides, "import").values), plugins=plugins)
