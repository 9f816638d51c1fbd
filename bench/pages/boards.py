"""The leaderboards of a page: the lines that `detailbench leaderboard` prints, for every way to make tables."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..text import one_line
from .encoding import number

if TYPE_CHECKING:
    import pandas as pd

    from ..ranking.report.tables import Metric, Table

GROUP = ("task", "dataset", "sensor", "split")
CONTENDER = ("method", "variant", "threads", "device", "host")
MARKS = " ‡§¶"  # behind the name of a method, see bench.ranking.report.table
NUMBERS = (
    "mean", "ci_low", "ci_high", "floor", "rank_low", "rank_high", "solved", "planned", "imputed", "seconds_median",
    "peak_rss_mb", "train_seconds", "shapes", "score_mean", "front",
)  # fmt: skip
MOST_COMPARED = 12  # methods compared pairwise per table and metric; the best ones if there are more
FEWEST_SHAPES = 4  # as for ranks


@dataclass(frozen=True)
class Way:
    """One way to make tables."""

    name: str  # as for `leaderboard --by`
    title: str


def ways(rows: pd.DataFrame) -> list[Way]:
    """The ways to make tables that differ for these rows, the pooled one first."""
    datasets, sensors = rows["dataset"].nunique(), rows["sensor"].nunique()
    tagged = rows["tags"].fillna("").astype(str).str.strip().ne("").any()
    found = [Way("task", "all pooled")]
    found += [Way("dataset", "by dataset")] if datasets > 1 else []
    found += [Way("sensor", "by sensor")] if sensors > 1 else []
    found += [Way("dataset,sensor", "by dataset and sensor")] if datasets > 1 and sensors > 1 else []
    return found + ([Way("tag", "by tag")] if tagged else [])


def boards(rows: pd.DataFrame, *, level: float, equal: float) -> dict[str, Any]:
    """All tables of all ways.

    Returns
    -------
    dict
        ``ways``, and ``groups``: one for each table, with its names, its metrics (in the order of `leaderboard`), its
        lines by metric and its notes.
    """
    from ..ranking.leaderboard import leaderboard
    from ..ranking.report.cells import plain_texts
    from ..ranking.report.tables import tables
    from ..ranking.selection import pool
    from ..results.imputation import lent

    chosen = ways(rows)
    groups: list[dict[str, Any]] = []
    for way in chosen:
        board = leaderboard(rows, by=way.name, level=level, equal=equal)
        pooled = pool(lent(rows), way.name)
        parts = dict(iter(pooled.groupby(list(GROUP), sort=False, dropna=False)))
        lines = board.assign(front=board["front"].astype("float64")).to_dict("records")
        named = itertools.groupby(lines, key=lambda line: tuple(line[name] for name in GROUP))
        shown = tables(plain_texts(board), plain_texts(pooled))
        for (key, own), table in zip(named, shown, strict=True):
            groups.append(_group(way, key, list(own), table, parts[key], level, equal))
    return {"ways": [vars(way) for way in chosen], "groups": groups}


def _group(
    way: Way, key: Sequence[str], lines: list[dict], table: Table, rows: pd.DataFrame, level: float, equal: float
) -> dict[str, Any]:
    from ..ranking.naming import naming
    from ..ranking.report.labels import setup, shown_setup, with_setup
    from ..ranking.report.look import Look
    from ..ranking.report.table import standing_notes

    shown = shown_setup(lines)
    printed = [(one_line(line["method"]), one_line(line["variant"])) for line in lines]  # as in tables
    called = naming(printed, Look().names).labels
    for line, name in zip(lines, printed, strict=True):
        line["label"] = with_setup(called[name], setup(line, shown))
    marked = {text.rstrip(MARKS): text for text in table.methods}
    by_metric = {
        metric.name: [line for line in lines if line["metric"] == metric.name] for metric in table.metrics
    } or {"": lines}
    own = {name: _rank_notes(name, part, level, equal) for name, part in by_metric.items() if name}
    special = {note for notes in own.values() for note in notes}
    columns = {metric.name: metric for metric in table.metrics}
    return {
        "by": way.name,
        **dict(zip(GROUP, key, strict=True)),
        "title": table.title,
        "shapes": int(rows["case"].nunique()),
        "cells": int(rows["cell"].nunique()),
        "notes": [
            *(note for note in table.notes if note not in special),
            *standing_notes([table], "Bold", "Italic"),
        ],
        "contenders": [
            {"label": name, "marked": marked.get(name, name)} | {part: line[part] for part in CONTENDER}
            for name, line in {line["label"]: line for line in lines}.items()
        ],
        "metrics": [
            _metric(name, part, columns.get(name), table, own.get(name, []), rows) for name, part in by_metric.items()
        ],
    }


def _metric(
    name: str, lines: list[dict], column: Metric | None, table: Table, notes: list[str], rows: pd.DataFrame
) -> dict[str, Any]:
    """One metric of a table: its lines, best first, as numbers and as `leaderboard` prints them."""
    from ..ranking.report.standing import is_ranked
    from ..ranking.report.terminal import heading

    ranked = is_ranked(lines)
    texts = {}
    if column is not None:
        texts = {method.rstrip(MARKS): cell for method, cell in zip(table.methods, column.cells, strict=True)}
    printed = [texts.get(line["label"]) for line in lines]
    found = {
        "name": name,
        "heading": heading(column) if column else name,
        "better": lines[0]["better"],
        "exponent": column.exponent if column else 0,
        "floor_text": column.floor if column else "",
        "notes": notes,
        "labels": [line["label"] for line in lines],
        "texts": [f"{cell.text}{' ' * cell.tied}{cell.signs}" if cell else "-" for cell in printed],
        "best": [bool(cell and cell.best) for cell in printed],
        "second": [bool(cell and cell.second) for cell in printed],
        "ranks": [_rank(line, ranked) for line in lines],
    }
    found |= {key: [number(line[key]) for line in lines] for key in NUMBERS}
    if name and int(max(line["shapes"] for line in lines)) >= FEWEST_SHAPES and len(lines) > 1:
        found["duels"] = duels(rows, name, [tuple(line[part] for part in CONTENDER) for line in lines])
    return found


def _rank(line: dict, ranked: bool) -> str:
    """``2-4``; ``-`` if nothing was solved, and for all if there are too few shapes for ranks."""
    if not ranked or not line["solved"]:
        return "-"
    low, high = line["rank_low"], line["rank_high"]
    return str(low) if low == high else f"{low}-{high}"


def _rank_notes(name: str, lines: list[dict], level: float, equal: float) -> list[str]:
    """The notes of `leaderboard` below a table about the resolution of its ranks."""
    from ..ranking.report import standing

    about = standing.rank_notes(name, level) if standing.is_ranked(lines) else []
    labels = [line["label"] for line in lines]
    return [*standing.resolution(name, lines), *standing.equality(lines, labels, equal), *about]


def duels(rows: pd.DataFrame, metric: str, order: Sequence[tuple]) -> dict[str, Any]:
    """Pairwise comparison of the methods of a table: win rates and average ranks.

    Parameters
    ----------
    rows : DataFrame
        Of the table, pooled.
    metric : str
    order : sequence of tuples
        The contenders, best first; of more than :data:`MOST_COMPARED` the first ones are compared.
    """
    from ..ranking.comparison import average_ranks, win_rates
    from ..ranking.leaderboard import unit_scores

    scores = unit_scores(rows, metric)
    known = list(scores.contenders[list(CONTENDER)].itertuples(index=False, name=None))
    solved = [key for key in order if key in known][:MOST_COMPARED]
    place = [known.index(key) for key in solved]
    values, planned = scores.values[:, place], scores.planned[:, place]
    cases = scores.units["case"].to_numpy()
    starts = np.flatnonzero(np.r_[True, cases[1:] != cases[:-1]])
    wins, low, high, shapes = win_rates(values, planned, starts)
    ranks = average_ranks(values, planned, starts)
    return {
        "labels": [order.index(key) for key in solved],
        "wins": _nested(wins), "low": _nested(low), "high": _nested(high), "shapes": _nested(shapes),
        "ranks": [number(value) for value in ranks.ranks],
        "blocks": ranks.blocks, "statistic": number(ranks.statistic), "p": number(ranks.p),
        "critical": number(ranks.critical),
    }  # fmt: skip


def _nested(array: np.ndarray) -> list[list[float | int | str | None]]:
    return [[number(float(f"{value:.4g}")) for value in line] for line in array]
