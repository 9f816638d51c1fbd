"""The contents of a page beyond the rows of the index: traces, tracebacks, parameters, and the origin of results."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from .encoding import number

if TYPE_CHECKING:
    import pandas as pd

    from ..results.store import Record, Results

MOST_STATES = 200  # of a trace: an even choice of them
LONGEST_TRACEBACK = 4_000
MACHINE = ("host", "system", "processor", "processors", "memory_gb", "python")


@dataclass
class Kept:
    """The data read from the records."""

    cells: dict[str, dict[str, Any]] = field(default_factory=dict)  # by cell: folder, plugins, parameters, limits
    traces: list[dict[str, Any]] = field(default_factory=list)
    tracebacks: dict[tuple[str, str], str] = field(default_factory=dict)  # by cell and case
    provenance: dict[str, Any] = field(default_factory=dict)


def read_records(rows: pd.DataFrame, results: Sequence[Results]) -> Kept:
    """Read the record of every cell of the rows; one that cannot be read is left out.

    Parameters
    ----------
    rows : DataFrame
        With ``cell``, ``fingerprint`` and ``case``; their places, counted from 0, are the ``row`` of a trace.
    results : sequence of Results
        The folders to look in.
    """
    kept = Kept()
    where = {key: place for place, key in enumerate(zip(rows["cell"], rows["fingerprint"], rows["case"], strict=True))}
    machines: dict[str, dict[str, Any]] = {}
    packages: Counter[tuple[str, str]] = Counter()
    versions: Counter[str] = Counter()
    for cell, fingerprint in dict.fromkeys(zip(rows["cell"], rows["fingerprint"], strict=True)):
        record, folder = _found(results, cell, fingerprint)
        if record is None:
            continue
        kept.cells[cell] = _cell(record, folder)
        _read_rows(kept, record, where)
        made = record.meta.get("provenance") or {}
        _add_machine(machines, made, rows, cell)
        versions[_version(made)] += 1
        for key, value in (record.meta.get("ingredients") or {}).items():
            if key.startswith("package "):
                packages[key.removeprefix("package "), str(value)] += 1
    kept.provenance = {
        "machines": sorted(machines.values(), key=lambda machine: str(machine.get("host"))),
        "packages": [{"name": n, "version": v, "cells": c} for (n, v), c in sorted(packages.items())],
        "versions": [{"version": v, "cells": c} for v, c in sorted(versions.items())],
    }
    return kept


def _found(results: Sequence[Results], cell: str, fingerprint: str) -> tuple[Record | None, str]:
    for folder in results:
        if (record := folder.read(cell, fingerprint)) is not None:
            return record, _name_of(folder)
    return None, ""


def _name_of(results: Results) -> str:
    """The folder for a command in the working folder: relative if it lies below."""
    from pathlib import Path

    folder = results.folder
    here = Path.cwd()
    return folder.relative_to(here).as_posix() if folder.is_relative_to(here) else folder.as_posix()


def _cell(record: Record, folder: str) -> dict[str, Any]:
    cell = record.meta.get("cell") or {}
    settings = record.meta.get("settings") or {}
    limit = settings.get("limit") or {}
    described = {
        kind: (cell.get(kind) or {}).get("parameters") or {} for kind in ("method", "dataset", "sensor", "task")
    }
    return {
        "folder": folder,
        "profile": str(settings.get("profile") or ""),
        "plugins": [str(file) for file in settings.get("plugins") or ()],
        "parameters": {kind: json.dumps(values) for kind, values in described.items() if values},
        "limit": {name: number(limit.get(name)) for name in ("seconds", "memory_gb") if name in limit},
    }


def _read_rows(kept: Kept, record: Record, where: Mapping[tuple[str, str, str], int]) -> None:
    for row in record.rows:
        place = where.get((record.cell, record.fingerprint, row["case"]))
        if place is None:
            continue
        if isinstance(row.get("traceback"), str) and row["traceback"] and row["status"] != "ok":
            kept.tracebacks[record.cell, row["case"]] = row["traceback"][-LONGEST_TRACEBACK:]
        states = _states(row.get("trace"))
        if states:
            kept.traces.append({"row": place, **states})


def _states(trace: Any) -> dict[str, Any]:
    """``{"seconds": [...], "scores": {metric: [...]}}`` of a trace; empty if there is no readable one."""
    try:
        states = json.loads(trace) if isinstance(trace, str) and trace else []
    except json.JSONDecodeError:
        return {}
    states = [s for s in states if isinstance(s, dict) and isinstance(s.get("seconds"), int | float)]
    if not states:
        return {}
    step = math.ceil(len(states) / MOST_STATES)
    states = states[: len(states) - 1 : step] + states[-1:]
    names = sorted({key for state in states for key in state if key.startswith("score.")})
    scores = {name.removeprefix("score."): [number(state.get(name)) for state in states] for name in names}
    return {"seconds": [number(state["seconds"]) for state in states], "scores": scores} if scores else {}


def _add_machine(machines: dict[str, dict[str, Any]], made: Mapping[str, Any], rows: pd.DataFrame, cell: str) -> None:
    known = {name: made.get(name) for name in MACHINE if made.get(name) is not None}
    key = json.dumps(known, sort_keys=True, default=str)
    machine = machines.setdefault(key, {**known, "cells": 0, "first": "", "last": ""})
    machine["cells"] += 1
    times = [text for text in rows.loc[rows["cell"] == cell, "finished"] if isinstance(text, str) and text]
    for text in times:
        machine["first"] = min(filter(None, (machine["first"], text)))
        machine["last"] = max(machine["last"], text)


def _version(made: Mapping[str, Any]) -> str:
    """``0.1.0, commit 1a2b3c4d (edited)``."""
    commit = made.get("commit") or {}
    name = str(made.get("detailbench") or "unknown")
    if not isinstance(commit, dict) or not commit.get("commit"):
        return name
    return f"{name}, commit {str(commit['commit'])[:8]}{' (edited)' if commit.get('dirty') else ''}"
