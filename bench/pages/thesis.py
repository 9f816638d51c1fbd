"""A paper's numbers beside ours, with a status for each method."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .encoding import number

if TYPE_CHECKING:
    import pandas as pd

    from ..ranking.conventions import Column, Convention
    from ..ranking.naming import Naming
    from ..ranking.published import Published

NEAR = 0.1  # a relative difference to the paper's number that counts as equal
FAR = 2.0  # times the paper's number: up to here a method works, though it does not reproduce the number
STATUSES = {
    "reproduces": f"reproduces: within {NEAR:.0%} of the paper's number, or better, or our interval contains it",
    "works": f"works: all cases solved, the number within a factor of {FAR:g}",
    "differs": "differs: farther off, or cases failed",
    "not run": "not run: no row of these results has the paper's method and parameters",
}


def comparisons(
    rows: pd.DataFrame, names: Sequence[str] | None, cells: Mapping[str, Mapping[str, Any]], *, level: float
) -> list[dict[str, Any]]:
    """The tables of papers that the rows can be compared with: one entry for each experiment and column.

    Parameters
    ----------
    rows : DataFrame
        One row per planned case.
    names : sequence of str or None
        Experiments; by default those whose dataset and at least one method are in the rows.
    cells : mapping
        What is known of each cell, see :class:`bench.pages.records.Kept`: its ``profile`` tells how long it was to run.
    level : float
        Of the intervals.

    Raises
    ------
    UsageError
        For a named experiment that is unknown, reproduces no paper's table, or prints scores that the rows lack.
    """
    from ..plugins.presets import names as known_names
    from ..ranking.published import GROUP, has_published, load_published

    if not (rows["status"] == "ok").any():
        return []
    found = []
    every = [name for name in known_names(GROUP) if has_published(name)] if names is None else names
    for name in every:
        table = load_published(name)
        mine = rows if names is not None else _of_experiment(rows, name)
        if len(mine):
            found.extend(_tables(name, table, mine, cells, level, asked=names is not None))
    return found


def _of_experiment(rows: pd.DataFrame, name: str) -> pd.DataFrame:
    """The rows over the dataset of an experiment."""
    from ..ranking.published import content_of_experiment

    entries = content_of_experiment(name).get("defaults") or []
    chosen = {str(entry["override /dataset"]) for entry in entries if "override /dataset" in entry}
    return rows[rows["dataset"].str.partition("[")[0].isin(chosen).to_numpy()]


def _tables(
    name: str,
    table: Published,
    rows: pd.DataFrame,
    cells: Mapping[str, Mapping[str, Any]],
    level: float,
    asked: bool,
) -> list[dict[str, Any]]:
    """One entry for each column of the paper's convention that the rows have."""
    from ..ranking.conventions import load_convention
    from ..ranking.leaderboard import leaderboard
    from ..ranking.naming import naming
    from ..ranking.selection import metrics_of

    known = metrics_of(rows)
    paper = load_convention(table.convention).of(known)
    if not asked and not any(column.score in known for column in paper.columns):
        return []
    board = paper.view(leaderboard(rows, by=table.by, metric=paper.scores(known), level=level))
    profiles = _profiles(rows, cells)
    found = []
    for column in paper.columns:
        mine = board[board["metric"] == column.title]
        names = naming(zip(mine["method"], mine["variant"], strict=True))  # as in the tables
        lines = _lines(mine, table, column, profiles, names)
        if any(line["ours"] is not None for line in lines):
            entry = _entry(name, table, _noted(paper, column, known), column, lines)
            found.append(entry | {"notes": [*entry["notes"], *names.notes]})
    return found


def _noted(paper: Convention, column: Column, known: Collection[str]) -> Convention:
    """The convention with this column alone and those that the results lack, which its notes name."""
    columns = tuple(one for one in paper.columns if one is column or one.score not in known)
    return replace(paper, columns=columns)


def _entry(
    name: str, table: Published, paper: Convention, column: Column, lines: list[dict[str, Any]]
) -> dict[str, Any]:
    told = dict.fromkeys(line["status"] for line in lines)
    return {
        "experiment": name,
        "column": column.title,
        "source": table.source,
        "short": table.short,
        "lines": lines,
        "notes": [*(STATUSES[status] for status in STATUSES if status in told), *paper.notes([column.title])],
    }


def _lines(
    board: pd.DataFrame, table: Published, column: Column, profiles: Mapping[tuple[str, str], str], names: Naming
) -> list[dict[str, Any]]:
    """Our methods with a number in the paper, and the paper's methods that are not among ours."""
    from ..ranking.published import all_parameters

    found = []
    for line in board.to_dict("records"):
        method, variant = line["method"], line["variant"]
        theirs = table.line(column.title, method, variant, line["sensor"])
        if theirs is not None:
            value, profile = float(theirs.values[column.title]), profiles.get((method, variant), "")
            found.append(
                _line(names.labels[method, variant], line, value, column.digits, _why(line, profile, theirs.why))
            )
    ours = [(line["method"], all_parameters(line["method"], line["variant"])) for line in board.to_dict("records")]
    for other in table.lines:
        if column.title in other.values and not any(
            other.is_of(method, parameters, other.sensor) for method, parameters in ours
        ):
            empty = dict.fromkeys(("ours", "low", "high", "ratio", "solved", "planned"))
            theirs = number(other.values[column.title])
            found.append(
                {"label": other.title, "sensor": other.sensor, "theirs": theirs, "text": "-", "status": "not run"}
                | empty
                | {"why": ""}
            )
    return found


def _line(who: str, line: dict[str, Any], theirs: float, digits: int, why: str) -> dict[str, Any]:
    from ..ranking.report.numbers import with_interval

    ours = line["mean"]
    status = status_of(ours, line["ci_low"], line["ci_high"], theirs, line["better"], line["solved"], line["planned"])
    return {
        "label": who,
        "sensor": line["sensor"],
        "theirs": number(theirs),
        "ours": number(ours),
        "low": number(line["ci_low"]),
        "high": number(line["ci_high"]),
        "text": with_interval(ours, line["ci_low"], line["ci_high"], 0, digits),
        "ratio": number(ours / theirs) if theirs else None,
        "solved": number(line["solved"]),
        "planned": number(line["planned"]),
        "status": status,
        "why": why if status != "reproduces" else "",
    }


def status_of(ours: float, low: float, high: float, theirs: float, better: str, solved: int, planned: int) -> str:
    """The status of our number relative to a paper's.

    Example
    -------
    >>> status_of(1.05, 0.9, 1.2, 1.0, "lower", 8, 8)
    'reproduces'
    >>> status_of(1.8, 1.7, 1.9, 1.0, "lower", 8, 8)
    'works'
    >>> status_of(1.0, 0.9, 1.1, 1.0, "lower", 7, 8)
    'differs'
    """
    if not math.isfinite(ours) or solved < planned:
        return "differs"
    ahead = ours <= theirs if better == "lower" else ours >= theirs if better == "higher" else False
    if ahead or abs(ours - theirs) <= NEAR * abs(theirs) or low <= theirs <= high:
        return "reproduces"
    small, large = sorted((abs(ours), abs(theirs)))
    return "works" if large <= FAR * small else "differs"


def _why(line: dict[str, Any], profile: str, known: str) -> str:
    """The known reasons for a difference: failures, a shorter profile, the explanation in the experiment."""
    failed = line["planned"] - line["solved"]
    parts = [f"{failed} of {line['planned']} cases failed"] if failed else []
    parts += [f"run in the profile {profile}, shorter than the paper's"] if profile not in ("", "paper") else []
    return "; ".join([*parts, *([known] if known else [])])


def _profiles(rows: pd.DataFrame, cells: Mapping[str, Mapping[str, Any]]) -> dict[tuple[str, str], str]:
    """The profiles that each method was run in."""
    found: dict[tuple[str, str], set[str]] = {}
    for cell, method, variant in rows[["cell", "method", "variant"]].drop_duplicates().itertuples(index=False):
        if profile := cells.get(cell, {}).get("profile"):
            found.setdefault((method, variant), set()).add(profile)
    return {key: ", ".join(sorted(profiles)) for key, profiles in found.items()}
