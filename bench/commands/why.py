"""Say why a stored cell is current or not: what differs between the day it was run and today.

  detailbench why CELL results=DIR

CELL is a cell id, or its beginning; `detailbench plan` prints them, and every row of the results has one.
"""

from __future__ import annotations

import argparse

from ..cli import add_plugin_argument
from ..devices import check_device
from ..errors import UsageError
from ..plan import Cell
from ..registry import load_plugins
from ..store import Record, Results


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_cell_arguments(parser)


def add_cell_arguments(parser: argparse.ArgumentParser) -> None:
    """A cell and the folder it is in."""
    parser.add_argument("cell", metavar="CELL", help="a cell id, or its beginning")
    parser.add_argument("folder", metavar="results=DIR", nargs="?", default="results=results", help="where to look")
    add_plugin_argument(parser)


def newest_record(cell: str, folder: str) -> tuple[Results, Record]:
    """The results folder, and the newest record of the one cell whose id begins so."""
    key, equals, path = folder.rpartition("=")
    if equals and key != "results":
        raise UsageError(f"{folder}: expected results=DIR")
    results = Results(path)
    records = results.records(results.find_cell(cell))
    if not records:
        raise UsageError(f"cell {cell} in {results.folder}: {'; '.join(results.damaged) or 'has no record'}")
    return results, records[0]


def run(args: argparse.Namespace) -> int:
    """Print what the newest record is, and what differs."""
    from ..provenance import explain, ingredients

    load_plugins(args.plugin)
    results, record = newest_record(args.cell, args.folder)
    stored_plugins = record.meta["settings"]["plugins"]
    load_plugins([p for p in stored_plugins if p not in args.plugin], warn=False)
    cell = Cell.from_json(record.meta["cell"])
    print(f"cell {cell.id}: {cell.title}")
    host, count = record.meta["provenance"]["host"], f"{record.solved}/{len(record.rows)} solved"
    print(f"run {record.meta['finished']} on {host}: {count}")
    for row in record.rows:
        if row["status"] != "ok":
            print(f"  {row['case']}: {row['status']}: {row['message']}")
    differences = explain(record.meta["ingredients"], ingredients(cell))
    again = "" if differences else to_run_again(cell, record)
    if again:
        print(again)
    elif not differences:
        print("current: parameters, sources, packages and metrics are those of today; it would not be run again")
    for line in differences:
        print(f"  {line}")
    if differences:
        print("not current: `detailbench run` with these words would run it again")
    return 0


def to_run_again(cell: Cell, record: Record) -> str:
    """What of a record that differs in nothing is run again all the same, and whether it can be; empty for nothing."""
    from ..runner import rows_to_repeat

    count = len(rows_to_repeat(record))
    if not count:
        return ""
    text = f"{count} of {len(record.rows)} cases ended before the method was called: `detailbench run` runs them again"
    try:
        check_device(cell.device)
    except UsageError as error:
        return f"{text}, which cannot be done here: {error}"
    return text
