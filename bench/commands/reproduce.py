"""Run a stored cell again, from its record, and compare every score.

  detailbench reproduce CELL results=DIR
  detailbench reproduce CELL results=DIR --plugin FILE           a cell that was run with a plugin file
  detailbench reproduce CELL results=DIR dataset.path=FOLDER     where its data are here

Seed, parameters and limits are those of the record. A plugin file that it names is not imported, since importing runs
it: name one that you trust. The result goes to a temporary folder: the stored one does not change, and files that the
record writes elsewhere (method.save=FILE) are not written. A program that the record names (method=external) is started
only with --allow-program, which says that you trust it. Exit code 0 when all cases agree, 3 when some do not.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from dataclasses import replace
from typing import Any

from ..errors import UsageError
from ..plugins.registry import load_plugins
from ..results.store import Record
from .why import add_cell_arguments, stored_cell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_cell_arguments(parser)
    parser.add_argument("--allow-program", action="store_true", help="start the program that the record names")
    parser.add_argument("--rtol", type=float, default=1e-9, help="relative difference that still counts as equal")


def run(args: argparse.Namespace) -> int:
    """Run, compare, and report what differs among the things the result depends on."""
    from ..engine.runner import forget_servers, run_cell
    from ..results.recorded import writing_nothing

    load_plugins(args.plugin)
    stored = stored_cell(args)
    record, plugins = stored.shown, stored.load(args.plugin)
    cell = stored.cell
    if not args.allow_program:
        check_programs(cell)
    print(f"cell {record.cell}: {cell.title}")
    for line in stored.differences(cell):
        print(f"  differs: {line}")
    cell, outputs = writing_nothing(cell)
    for output in outputs:
        print(f"  not written: {output}")
    with tempfile.TemporaryDirectory(prefix="detailbench-") as folder:
        settings = replace(stored.settings, results=folder, outputs="none", plugins=plugins)
        try:
            again = run_cell(cell, settings).record
        finally:
            forget_servers()
    differences = compare(record, again, args.rtol)
    for line in differences:
        print(f"  {line}")
    print("reproduced: every status and score agrees" if not differences else f"{len(differences)} differences")
    return 3 if differences else 0


def check_programs(cell: Any) -> None:
    """Refuse a cell that starts a program which the record names: it may come from anybody and do anything.

    Raises
    ------
    UsageError
        With the parameters that name it.
    """
    for part in cell.method.parts:
        if named := getattr(part.cls, "runs", ()):
            values = {key: cell.method.parameters.get(key) or "" for key in named}
            said = ", ".join(f"method.{key}={value}" for key, value in values.items() if value) or part.name
            raise UsageError(
                f"cell {cell.id} starts a program that its record names: {said}. Read it, and add --allow-program if "
                "you trust it"
            )


def compare(stored: Record, again: Record, rtol: float) -> list[str]:
    """What differs between two records of a cell, one line per case and score."""
    now = {row["case"]: row for row in again.rows}
    lines = []
    for then in stored.rows:
        row = now.get(then["case"])
        if row is None:
            lines.append(f"{then['case']}: the dataset no longer has this case")
        elif row["status"] != then["status"]:
            lines.append(f"{then['case']}: was {then['status']}, is {row['status']}: {row['message']}")
        else:
            keys = sorted(k for k in {*then, *row} if k.startswith("score."))
            lines.extend(
                f"{then['case']}: {key.removeprefix('score.')} was {then.get(key)}, is {row.get(key)}"
                for key in keys
                if not _close(then.get(key), row.get(key), rtol)
            )
    return lines


def _close(a: Any, b: Any, rtol: float) -> bool:
    if a is None or b is None or math.isnan(a) or math.isnan(b):
        return (a is None or math.isnan(a)) and (b is None or math.isnan(b))
    return math.isclose(a, b, rel_tol=rtol, abs_tol=1e-15)
