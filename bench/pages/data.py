"""All that a page shows, as JSON: tables, cases, failures, traces, a paper's numbers and the origin of the rows."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from .boards import CONTENDER, GROUP, boards
from .encoding import columns, number
from .records import Kept, read_records

if TYPE_CHECKING:
    import pandas as pd

    from ..results.store import Results

FORMAT = 1  # of the JSON
CASE_COLUMNS = (
    "cell", *GROUP, *CONTENDER, "seed", "case", "tags", "status", "stage", "message", "seconds", "cpu_seconds",
    "peak_rss_mb", "peak_device_mb", "parameters", "true_distances", "weights", "output_points", "output_faces",
    "finished",
)  # fmt: skip
MOST_FAILURES = 400  # kinds of messages


def page_data(
    rows: pd.DataFrame,
    results: Sequence[Results] = (),
    *,
    title: str = "detailbench",
    level: float = 0.95,
    equal: float = 0.02,
    published: Sequence[str] | None = None,
) -> dict[str, Any]:
    """The data of the page.

    Parameters
    ----------
    rows : DataFrame
        One row per planned case.
    results : sequence of Results
        The folders that the rows are of: traces, tracebacks and provenance are read there.
    title : str
        Of the page.
    level, equal : float
        As of `detailbench leaderboard`.
    published : sequence of str, optional
        Experiments whose papers' numbers are shown beside ours; by default those that the rows belong to.

    Returns
    -------
    dict
        Of JSON values: no NaN, no infinity.
    """
    from ..ranking.selection import completed
    from .thesis import comparisons

    rows = completed(rows).reset_index(drop=True)
    kept = read_records(rows, results)
    for cell, about in kept.cells.items():
        about["command"] = command_of(cell, kept.cells)
    return {
        "format": FORMAT,
        "title": title,
        "level": level,
        "equal": equal,
        "about": _about(rows),
        **boards(rows, level=level, equal=equal),
        "cases": _cases(rows, kept),
        "failures": _failures(rows, kept),
        "traces": kept.traces,
        "published": comparisons(rows, published, kept.cells, level=level),
        "provenance": kept.provenance,
        "scenes": [],
    }


def _about(rows: pd.DataFrame) -> dict[str, Any]:
    """The size of the results."""
    finished = sorted(text for text in rows["finished"] if isinstance(text, str) and text)
    solved = int((rows["status"] == "ok").sum())
    return {
        "rows": len(rows),
        "solved": solved,
        "cells": int(rows["cell"].nunique()),
        "methods": int(rows[["method", "variant"]].drop_duplicates().shape[0]),
        "datasets": int(rows["dataset"].nunique()),
        "shapes": int(rows[["dataset", "split", "case"]].drop_duplicates().shape[0]),
        "first": finished[0] if finished else "",
        "last": finished[-1] if finished else "",
    }


def _cases(rows: pd.DataFrame, kept: Kept) -> dict[str, Any]:
    """Every row, by columns, and the facts stored once for each cell."""
    scores = sorted(name for name in rows.columns if name.startswith(("score.", "input.")))
    scores = [name for name in scores if rows[name].notna().any()]
    table = rows.reindex(columns=[*CASE_COLUMNS, *scores])
    table = table[[name for name in table if name in (*GROUP, *CONTENDER) or table[name].notna().any()]]
    better: dict[str, str] = {}
    for text in rows["directions"].dropna().unique():
        better |= json.loads(text) if text else {}
    return {"columns": columns(table), "count": len(rows), "better": better, "cells": kept.cells}


def _failures(rows: pd.DataFrame, kept: Kept) -> list[dict[str, Any]]:
    """The failures, by kind of message, with the line that runs the first of the cells again."""
    from ..ranking.leaderboard import failures

    found = []
    lost = rows[(rows["status"] != "ok").to_numpy()]
    for line in failures(rows).head(MOST_FAILURES).to_dict("records"):
        message = line["message"] if isinstance(line["message"], str) else ""
        wanted = {name: line[name] for name in (*GROUP, "method", "variant", "case", "status")}
        same = (lost[list(wanted)] == list(wanted.values())).all(axis=1) & (lost["message"].fillna("") == message)
        cell = str(lost.loc[same, "cell"].iloc[0]) if same.any() else ""
        found.append(
            {name: line[name] for name in (*GROUP, "method", "variant", "device", "host", "status", "case")}
            | {"count": number(line["count"]), "message": message, "cell": cell}
            | {"command": command_of(cell, kept.cells), "traceback": kept.tracebacks.get((cell, line["case"]), "")}
        )
    return found


def command_of(cell: str, cells: Mapping[str, Mapping[str, Any]]) -> str:
    """The line that runs a stored cell again: ``detailbench reproduce CELL results=DIR``; empty if none is known."""
    if not cell:
        return ""
    about = cells.get(cell, {})
    words = ["detailbench", "reproduce", cell, f"results={about.get('folder', 'DIR')}"]
    for plugin in about.get("plugins", ()):
        words += ["--plugin", plugin]
    return shlex.join(words)
