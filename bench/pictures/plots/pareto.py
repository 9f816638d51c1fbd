"""Quality against cost: the mean of each method over its time or memory, with the front."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from ...errors import UsageError
from ...ranking.fronts import COSTS, on_front
from .style import MUTED, chart, looks, names_at_points, plain_log

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .kinds import Options
    from .scores import Scores

WORDS = {"seconds": "seconds of a case, median", "peak_mb": "peak memory, MiB"}
WIDE = 8  # times the smallest value: an axis that reaches further is logarithmic


def table(scores: Scores, options: Options) -> pd.DataFrame:
    """One row for each method: cost, mean with its interval, and whether it is on the front."""
    board = scores.board()
    found = pd.DataFrame(
        {
            "method": board["label"],
            "title": board["label"].map(scores.titles),
            options.cost: board[COSTS[options.cost]].astype(float),
            "metric": scores.metric,
            "mean": board["mean"].astype(float),
            "low": board["ci_low"].astype(float),
            "high": board["ci_high"].astype(float),
        }
    )
    found = found[np.isfinite(found["mean"]) & np.isfinite(found[options.cost])]
    if found.empty:
        raise UsageError(f"no method has both {scores.metric} and {options.cost}: nothing was solved")
    sign = -1 if scores.direction == "higher" else 1
    found["front"] = on_front(found[[options.cost, "mean"]].to_numpy() * [1, sign]).astype(int)
    return found.sort_values(options.cost, kind="stable").reset_index(drop=True)


def draw(table: pd.DataFrame, scores: Scores, options: Options) -> Figure:
    """A point for each method; those on the front are filled, and stairs join them."""
    figure, axes = chart(options.size[0], options.size[1] or 0.72 * options.size[0])
    cost, look = table[options.cost], looks(scores.order)
    for name in ("x", "y"):
        values = cost if name == "x" else table["mean"]
        if values.min() > 0 and values.max() > WIDE * values.min():
            getattr(axes, f"set_{name}scale")("log")
    on = table[table["front"] == 1]
    axes.step(on[options.cost], on["mean"], where="post", color=MUTED, linewidth=0.9, linestyle=(0, (4, 2)), zorder=1)
    for row in table.to_dict("records"):
        style = look[row["method"]]
        if np.isfinite(row["low"]) and not (axes.get_yscale() == "log" and row["low"] <= 0):
            axes.vlines(row[options.cost], row["low"], row["high"], color=style.color, linewidth=0.7, alpha=0.6)
        face = style.color if row["front"] else "white"
        axes.plot(row[options.cost], row["mean"], style.marker, color=style.color, markerfacecolor=face)
    axes.margins(0.16, 0.12)
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            plain_log(axis)
    axes.set_xlabel(WORDS[options.cost])
    axes.set_ylabel(scores.axis)
    points = {row["method"]: (row[options.cost], row["mean"]) for row in table.to_dict("records")}
    low = axes.get_ylim()[0]
    reach = table[["low", "high"]].fillna(low).clip(lower=low).to_numpy()
    lines = [np.column_stack([[x, x], pair]) for x, pair in zip(cost, reach, strict=True)]
    stairs = np.repeat(on[[options.cost, "mean"]].to_numpy(), 2, axis=0)
    lines.append(np.column_stack([stairs[1:, 0], stairs[:-1, 1]]))
    names_at_points(axes, points, scores.titles, lines)
    return figure
