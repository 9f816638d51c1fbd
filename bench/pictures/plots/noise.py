"""A metric against a parameter: of the sensor, as a sweep over noise, or of anything else that was swept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ...errors import UsageError, did_you_mean
from ...ranking.naming import parts_of
from ..labels import folder_of
from .style import chart, looks, name_width, names_at_ends, plain_log

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .kinds import Options
    from .scores import Scores

KINDS = ("sensor", "dataset", "method", "task")
LEVELS = 3  # digits of the measures of inputs: 0.00998 and 0.01003 are one level of noise


def table(scores: Scores, options: Options) -> pd.DataFrame:
    """One row for each method and value: the mean over shapes with its interval, and how many cases were solved."""
    rows, name = scores.rows, options.x
    found = _values(scores)
    if name is None:
        several = [key for key in found if key.startswith("sensor.") and len(set(found[key].dropna())) > 1]
        if len(several) != 1:
            raise UsageError(f"--x: choose the parameter of the x axis: {_listed(found)}")
        name = several[0]
    name = _one_of(name, found)
    if found[name].dropna().nunique() < 2:
        raise UsageError(f"--x {name}: has only one value, so there is no curve; {_listed(found)}")
    rows = rows.assign(__x=found[name])
    parts = []
    for x, part in rows.dropna(subset="__x").groupby("__x"):
        if not (part["status"] == "ok").any():
            continue
        board = scores.board(part.drop(columns="__x"))
        parts.append(
            pd.DataFrame(
                {
                    "method": _without(board["label"], name),
                    name: float(x),
                    **scores.means(board),
                }
            )
        )
    table = pd.concat(parts, ignore_index=True)
    order = {label: i for i, label in enumerate(_without(pd.Series(scores.order), name))}
    table = table.assign(__place=table["method"].map(order)).sort_values(["__place", name], kind="stable")
    table.insert(1, "title", [scores.titles.get(method, method) for method in table["method"]])
    return table.drop(columns="__place").reset_index(drop=True)


def _without(labels: pd.Series, name: str) -> list[str]:
    """Labels of methods without the parameter that the plot is over."""
    kind, _, key = name.partition(".")
    if kind != "method":
        return list(labels)
    found = []
    for label in labels:
        head, bracket, rest = label.partition(" (")
        inner, _, tail = rest.rpartition(")")
        kept = [part.strip() for part in parts_of(inner) if part.strip().partition("=")[0] != key.split(".")[0]]
        found.append((f"{head} ({', '.join(kept)})" if kept else head) + tail if bracket else label)
    return found


def _values(scores: Scores) -> dict[str, pd.Series]:
    """For each number that differs between rows, its value in each row: parameters, and the measures of inputs."""
    rows = scores.rows
    metas: dict[tuple[str, str], dict[str, float]] = {}
    for row in rows.drop_duplicates(["cell", "fingerprint"]).to_dict("records"):
        results = folder_of(scores.folders, row)
        cell = results.meta(row["cell"], row["fingerprint"]).get("cell") if results else None
        metas[row["cell"], row["fingerprint"]] = dict(_numbers(cell or {}))
    keys = list(zip(rows["cell"], rows["fingerprint"], strict=True))
    names = sorted({name for values in metas.values() for name in values})
    found = {name: pd.Series([metas[key].get(name, np.nan) for key in keys], rows.index) for name in names}
    for column in (c for c in rows.columns if c.startswith("input.")):
        level = pd.to_numeric(rows[column]).groupby(rows["sensor"]).transform("median")
        found[column] = level.map(lambda value: float(f"{value:.{LEVELS}g}"))
    return {name: series for name, series in found.items() if series.notna().any()}


def _numbers(cell: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """The numbers among the parameters of a cell, by ``KIND.PARAMETER``; of the steps of a chain, by their keys."""
    for kind in KINDS:
        node = cell.get(kind)
        if isinstance(node, Mapping):
            yield from _inner(kind, node.get("parameters") or {})


def _inner(where: str, node: Any) -> Iterator[tuple[str, float]]:
    if isinstance(node, Mapping):
        for key, value in node.items():
            yield from _inner(f"{where}.{key}", value)
    elif isinstance(node, (list, tuple)):
        for value in node:
            yield from _inner(where, value)
    elif isinstance(node, (int, float)) and not isinstance(node, bool):
        yield where, float(node)


def _one_of(name: str, found: Mapping[str, pd.Series]) -> str:
    """The full name of a parameter: ``sensor.noise`` also means ``sensor.steps.offset_noise.noise``."""
    if name in found:
        return name
    kind, _, key = name.partition(".")
    hits = [known for known in found if known.startswith(f"{kind}.") and known.endswith(f".{key}")]
    if len(hits) == 1:
        return hits[0]
    if hits:
        raise UsageError(f"--x {name}: names several numbers; choose one of {', '.join(hits)}")
    raise UsageError(f"--x {name}: no result has it. {did_you_mean(name, found)}")


def _listed(found: Mapping[str, pd.Series]) -> str:
    several = [name for name, series in found.items() if series.dropna().nunique() > 1]
    return f"choose --x {', '.join(several)}" if several else "all results have the same parameters"


def draw(table: pd.DataFrame, scores: Scores, options: Options) -> Figure:
    """A line for each method with its interval as a band, and its name at the end."""
    name = table.columns[2]
    titles = dict(zip(table["method"], table["title"], strict=True))
    width = options.size[0]
    figure, axes = chart(width, options.size[1] or 0.72 * width, right=name_width(titles) + 0.22)
    look, ends = looks(list(titles)), {}
    for method, line in table.groupby("method", sort=False):
        x, style = line[name], look[method]
        axes.fill_between(x, line["low"], line["high"], color=style.color, alpha=0.13, linewidth=0)
        axes.plot(x, line["mean"], marker=style.marker, color=style.color, linestyle=style.line)
        known = line.dropna(subset="mean")
        if len(known):
            ends[method] = (known[name].iloc[-1], known["mean"].iloc[-1])
    values = table[name]
    if values.min() > 0 and values.max() > 20 * values.min():
        axes.set_xscale("log")
        plain_log(axes.xaxis)
    means = table["mean"].dropna()
    if options.log and means.min() > 0:
        axes.set_yscale("log")
        plain_log(axes.yaxis)
    elif len(means) and means.min() >= 0:
        axes.set_ylim(0, 1.15 * max(means.max(), 1e-12))
    axes.set_xlabel(name)
    axes.set_ylabel(scores.axis)
    names_at_ends(axes, ends, titles, look)
    return figure
