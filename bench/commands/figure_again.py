"""`detailbench figure --recompute`: outputs that no run stored, for the duration of one command."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UsageError
from ..results.store import Results
from ..text import counted

if TYPE_CHECKING:
    import pandas as pd

    from ..results.recorded import Stored

RTOL = 1e-9  # as in `detailbench reproduce`


def recomputed(
    rows: pd.DataFrame, folders: Sequence[Results], folder: Path, *, plugins: Sequence[str], allow_program: bool
) -> tuple[pd.DataFrame, list[Results]]:
    """The rows with outputs for all cases that were solved, and the folders that these are in.

    Each cell that lacks some is run again for these cases, into ``folder``. Its scores stay those of the record; a note
    on stderr says where those of today are others.

    Raises
    ------
    UsageError
        If the cell of a record cannot be made here, or starts a program that was not allowed.
    """
    from ..engine.runner import forget_servers
    from ..pictures.labels import folder_of
    from .reproduce import check_programs

    lacking: dict[tuple[Path, str, str], tuple[Results, list[int]]] = {}
    for at, row in zip(rows.index, rows.to_dict("records"), strict=True):
        results = folder_of(folders, row)
        if row["status"] == "ok" and results is not None and results.output_of(row) is None:
            key = (results.folder, row["cell"], row["fingerprint"])
            lacking.setdefault(key, (results, []))[1].append(at)
    jobs = [(_stored(results, cell, mark), places) for (_, cell, mark), (results, places) in lacking.items()]
    loaded: tuple[str, ...] = ()
    for stored, _ in jobs:
        loaded = stored.load(plugins)
        if not allow_program:
            check_programs(stored.cell)
    rows = rows.copy()
    try:
        for stored, places in jobs:
            _run(rows, places, stored, folder, loaded)
    finally:
        forget_servers()
    return rows, [Results(folder), *folders]


def _stored(results: Results, cell: str, fingerprint: str) -> Stored:
    from ..results.checks import lacks
    from ..results.recorded import Stored

    record = results.read(cell, fingerprint)
    missing = ["a readable file"] if record is None else lacks(record.meta)
    if record is None or missing:
        raise UsageError(f"--recompute: the record of cell {cell} in {results.folder} lacks {', '.join(missing)}")
    return Stored(results, [record], record, {})


def _run(rows: pd.DataFrame, places: Sequence[int], stored: Stored, folder: Path, plugins: Sequence[str]) -> None:
    """Give the rows of one cell's cases their outputs, or record in them why there are none."""
    from ..engine.again import run_again
    from .reproduce import compare

    cases = [rows.at[at, "case"] for at in places]
    _say(f"cell {stored.shown.cell} ({stored.title}): running {counted(len(cases), 'case')} again")
    for line in stored.differences(stored.cell):
        _say(f"  differs: {line}")
    record = run_again(stored, folder, cases, plugins)
    for line in compare(stored.shown, record, RTOL):
        _say(f"  {line}")
    now = {row["case"]: row for row in record.rows}
    for at, case in zip(places, cases, strict=True):
        for name, value in _changes(now.get(case)).items():
            rows.at[at, name] = value


def _changes(now: dict[str, Any] | None) -> dict[str, Any]:
    """The changes of a row: its new output, or the reason why there is none."""
    if now is None:
        return {"status": "error", "message": "run again: the dataset has no such case today"}
    if now["status"] != "ok":
        return {"status": now["status"], "message": f"run again: {now['message'] or 'no message'}"}
    return {name: now[name] for name in ("cell", "fingerprint", "output")}


def _say(line: str) -> None:
    print(line, file=sys.stderr)
