"""Error against time: the traces of iterative methods, and the results of all methods.

A thick line is the geometric mean of a method over its cases, thin lines are the cases, a marker is the result. Methods
without traces are markers: the median time, and the geometric mean.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ...errors import UsageError
from ...ranking.selection import UNIT
from ..labels import folder_of
from .style import chart, looks, names_at_points, plain_log

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .kinds import Options
    from .scores import Scores

TINY = 1e-12  # of an error on a logarithmic axis
STEPS = 40  # of a mean curve


def table(scores: Scores, options: Options) -> pd.DataFrame:
    """Rows of three kinds (``part``): ``case`` and ``mean`` of traces, and the ``result`` of each method."""
    traces = _traces(scores)
    parts = []
    for name in scores.order:
        mine = scores.rows[(scores.rows["label"] == name) & (scores.rows["status"] == "ok")]
        errors = pd.to_numeric(mine[f"score.{scores.metric}"])
        done = mine[np.isfinite(errors)]
        if not len(done):
            continue
        lines = traces.get(name, {})
        for unit, line in lines.items():
            parts.append(_lines(name, "case", unit, line))
        if len(lines) > 1 and len(curve := mean_curve(list(lines.values()))):
            parts.append(_lines(name, "mean", "", curve))
        result = [[float(done["seconds"].median()), geometric_mean(errors[np.isfinite(errors)].to_numpy(dtype=float))]]
        parts.append(_lines(name, "result", "", np.array(result)))
    if not parts:
        raise UsageError(f"no solved case has {scores.metric}")
    table = pd.concat(parts, ignore_index=True)
    table.insert(1, "title", table["method"].map(scores.titles))
    table.insert(4, "metric", scores.metric)
    if not traces:
        table.attrs["notes"] = [
            "no result has a trace with this metric, so methods are points; iterative methods record traces with "
            "method.traces=8"
        ]
    return table


def _lines(name: str, part: str, case: str, points: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame({"method": name, "part": part, "case": case, "seconds": points[:, 0], "error": points[:, 1]})


def _traces(scores: Scores) -> dict[str, dict[str, np.ndarray]]:
    """The traces of each label, by unit: (points, 2) arrays of seconds and errors; the last point is the result."""
    found: dict[str, dict[str, np.ndarray]] = {}
    pooled = scores.pooled()
    for (cell, fingerprint), part in pooled.groupby(["cell", "fingerprint"], sort=False):
        results = folder_of(scores.folders, part.iloc[0])
        record = results.read(cell, fingerprint) if results else None
        kept = {row["case"]: row.get("trace") for row in record.rows} if record else {}
        for row, bare in zip(part.to_dict("records"), part["case"].str.partition("/")[2], strict=True):
            points = list(_points(kept.get(bare), f"score.{scores.metric}"))
            last = row.get(f"score.{scores.metric}")
            if points and row["status"] == "ok" and last is not None and math.isfinite(last):
                unit = " ".join(str(row[name]) for name in UNIT)
                line = np.array([*points, (row["seconds"], last)], dtype=float)
                found.setdefault(row["label"], {})[unit] = line[np.argsort(line[:, 0], kind="stable")]
    return found


def _points(trace: Any, key: str) -> Iterator[tuple[float, float]]:
    if isinstance(trace, str) and trace:
        for state in json.loads(trace):
            if state.get(key) is not None and math.isfinite(state[key]):
                yield state["seconds"], state[key]


def mean_curve(lines: list[np.ndarray]) -> np.ndarray:
    """The geometric mean of several curves, (points, 2): over the time that all of them have.

    Between two states the logarithm of the error is interpolated linearly. Empty where no time is common to all.
    """
    begin, end = max(line[0, 0] for line in lines), min(line[-1, 0] for line in lines)
    if not end > begin:
        return np.zeros((0, 2))
    seconds = np.geomspace(max(begin, 1e-3), end, STEPS)
    logs = [np.interp(seconds, line[:, 0], np.log(np.maximum(line[:, 1], TINY))) for line in lines]
    return np.column_stack([seconds, np.exp(np.mean(logs, axis=0))])


def geometric_mean(values: np.ndarray) -> float:
    """exp(mean(log(values))), of values that are not below a tiny one."""
    return float(np.exp(np.mean(np.log(np.maximum(values, TINY)))))


def draw(table: pd.DataFrame, scores: Scores, options: Options) -> Figure:
    """Both axes are logarithmic where the numbers allow it."""
    width = options.size[0]
    figure, axes = chart(width, options.size[1] or 0.72 * width)
    look, ends = looks(scores.order), {}
    if table["seconds"].min() > 0:
        axes.set_xscale("log")
    if table["error"].min() > 0:
        axes.set_yscale("log")
    for name, mine in table.groupby("method", sort=False):
        style = look[name]
        cases = mine[mine["part"] == "case"]
        for _, line in cases.groupby("case", sort=False):
            alone = cases["case"].nunique() == 1
            axes.plot(
                line["seconds"], line["error"], color=style.color, linestyle=style.line if alone else "-",
                linewidth=1.2 if alone else 0.6, alpha=1 if alone else 0.35,
            )  # fmt: skip
        mean = mine[mine["part"] == "mean"]
        axes.plot(mean["seconds"], mean["error"], color=style.color, linestyle=style.line, linewidth=1.6)
        result = mine[mine["part"] == "result"].iloc[0]
        axes.plot(result["seconds"], result["error"], style.marker, color=style.color)
        ends[name] = (result["seconds"], result["error"])
    axes.margins(0.12, 0.1)
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            plain_log(axis)
    axes.set_xlabel("seconds")
    axes.set_ylabel(scores.axis)
    lines = [line[["seconds", "error"]].to_numpy() for _, line in table.groupby(["method", "part", "case"])]
    names_at_points(axes, ends, scores.titles, lines)
    return figure
