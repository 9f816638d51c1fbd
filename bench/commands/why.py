"""Show why a stored cell is current or not: what changed since it was run.

  detailbench why CELL results=DIR
  detailbench why CELL results=DIR --plugin FILE           of a cell that was run with a plugin file
  detailbench why CELL results=DIR dataset.path=FOLDER     where its data are on this machine
  detailbench why CELL results=DIR --source                print the source of the plugin files that is in the record

CELL is a cell id, or its beginning; `detailbench plan` prints them, and every row of the results has one. Of several
records of a cell (of edited sources, of other versions), tables show the one that is current, or the newest where none
is. A plugin file that a record names is not imported, since importing runs it: name one that you trust.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ..cli import add_plugin_argument, warn_of_damaged
from ..engine.devices import check_device
from ..errors import UsageError
from ..plugins.registry import load_plugins

if TYPE_CHECKING:
    from ..results.recorded import Stored


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_cell_arguments(parser)
    parser.add_argument("--source", action="store_true", help="print the plugins' source that the record keeps")


def add_cell_arguments(parser: argparse.ArgumentParser) -> None:
    """A cell, the folder it is in, and what replaces the record's paths."""
    parser.add_argument("cell", metavar="CELL", help="a cell id, or its beginning")
    parser.add_argument(
        "words",
        metavar="results=DIR",
        nargs="*",
        help="the folder of results; dataset.path=FOLDER: where the data are here",
    )
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print which record is shown, what it is, and what differs."""
    from ..results.recorded import lines_of_source

    load_plugins(args.plugin)
    stored = stored_cell(args)
    record = stored.shown
    if args.source:
        lines = list(lines_of_source(record.meta))
        if not lines:
            why = "it was run with installed plugins only, or by an earlier version"
            raise UsageError(f"cell {record.cell}: its record has no source: {why}")
        print("\n".join(lines))
        return 0
    cell = None if stored.missing else stored.cell
    print(f"cell {record.cell}: {cell.title if cell else stored.title}")
    host, count = record.meta["provenance"].get("host", "an unknown host"), f"{record.solved}/{len(record.rows)} solved"
    print(f"run {record.meta['finished']} on {host}: {count}")
    for row in record.rows:
        if row["status"] != "ok":
            print(f"  {row['case']}: {row['status']}: {row['message']}")
    if cell:
        differences = stored.differences(cell)
        for line in differences:
            print(f"  {line}")
        print(verdict(stored, differences))
    else:
        _print_without_plugins(stored)
    _print_others(stored)
    stored.load(args.plugin)
    return 0


def stored_cell(args: argparse.Namespace) -> Stored:
    """The cell that the arguments name; files that were left out are reported."""
    from ..results.recorded import Stored

    stored = Stored.of(args.cell, args.words)
    warn_of_damaged(stored.results)
    return stored


def _print_without_plugins(stored: Stored) -> None:
    """What differs, as far as known without importing the plugins that the record names."""
    from ..results.current import Today

    differences = Today().differences(stored.shown.meta)
    if differences is None:
        print("cannot be compared with today without its plugin")
        return
    for line in differences:
        print(f"  {line}")
    what = "not current" if differences else "nothing differs"
    print(f"{what}, as far as can be told from the files without importing its plugin")


def verdict(stored: Stored, differences: list[str]) -> str:
    """Whether the record is current, and what a run with the same overrides would do."""
    if differences:
        return "not current: `detailbench run` with these overrides would run it again"
    from ..engine.runner import finished_rows
    from ..plan.cell import Cell

    record = stored.shown
    kept, _ = finished_rows(stored.results, Cell.from_json(record.meta["cell"]), record.fingerprint, stored.settings)
    again = len(record.rows) - len(kept)
    same = "current: parameters, sources, packages and metrics are those of today; "
    if again:
        text = (
            f"{same}all the same a run would repeat {again} of {len(record.rows)} cases: they were skipped, were never "
            "begun, or their outputs are gone"
        )
        try:
            check_device(stored.cell.device)
        except UsageError as error:
            return f"{text}; which cannot be done here: {error}"
        return text
    return f"{same}it would not be run again"


def _print_others(stored: Stored) -> None:
    """The other records of the cell, and which of them the tables show."""
    from ..results.current import Today

    if len(stored.records) == 1:
        return
    today = Today()
    print(f"{len(stored.records)} records of this cell; tables show the current one, or the newest where none is:")
    for record in stored.records:
        differences = today.differences(record.meta)
        state = "cannot be compared with today" if differences is None else "; ".join(differences) or "current"
        shown = ", shown in tables" if record is stored.shown else ""
        print(f"  {record.fingerprint} run {record.meta['finished']}: {state}{shown}")
