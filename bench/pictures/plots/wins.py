"""How often each method is better than each other method, as a matrix; see :mod:`bench.ranking.comparison`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from ...errors import UsageError
from ...ranking.comparison import win_rates
from ...ranking.leaderboard import unit_scores
from ..printing import POINT, fitted, text_width
from .style import FONT, INK, chart, name_width

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .kinds import Options
    from .scores import Scores

# From vermilion over white to blue, Okabe and Ito's: losing, even, winning.
LOSES, EVEN, WINS = (np.array(c) / 255 for c in ((213, 94, 0), (255, 255, 255), (0, 114, 178)))
CELL = (0.36, 0.24)  # inches, at least


def table(scores: Scores, options: Options) -> pd.DataFrame:
    """One row for each pair: how often the first is better, its interval, and on how many shapes both were run."""
    units = unit_scores(scores.pooled(), scores.metric)
    names = scores.label_of(units.contenders)
    starts = clusters(units.units)
    rate, low, high, shapes = win_rates(units.values, units.planned, starts, scores.level)
    if len(names) < 2:
        raise UsageError("a matrix of wins needs two methods or more")
    mean = np.array([np.nanmean(np.delete(line, i)) if len(line) > 1 else 0.5 for i, line in enumerate(rate)])
    order = sorted(range(len(names)), key=lambda i: (-np.nan_to_num(mean[i], nan=-1), names[i]))
    if scores.is_ordered:
        order = [names.index(name) for name in scores.order if name in names]
    lines = [
        {
            "method": names[i],
            "other": names[j],
            "metric": scores.metric,
            "rate": rate[i, j],
            "low": low[i, j],
            "high": high[i, j],
            "shapes": int(shapes[i, j]),
        }
        for i in order
        for j in order
        if i != j
    ]
    return pd.DataFrame(lines)


def clusters(units: pd.DataFrame) -> np.ndarray:
    """The first unit of each shape; of each seed if there is only one shape."""
    cases = units["case"].to_numpy()
    key = cases if len(set(cases)) > 1 else units["seed"].to_numpy()
    return np.flatnonzero(np.r_[True, key[1:] != key[:-1]])


def shade(rate: float) -> np.ndarray:
    """The colour of a rate: vermilion 0, white 0.5, blue 1."""
    if not np.isfinite(rate):
        return np.array([0.92, 0.92, 0.92])
    end, share = (WINS, 2 * rate - 1) if rate >= 0.5 else (LOSES, 1 - 2 * rate)
    return EVEN + 0.85 * share * (end - EVEN)


def draw(table: pd.DataFrame, scores: Scores, options: Options) -> Figure:
    """Rows beat columns; bold where the interval leaves out one half."""
    names = list(dict.fromkeys(table["method"]))
    titles = [scores.titles[name] for name in names]
    n, side = len(names), name_width({name: scores.titles[name] for name in names}) + 0.08
    width = options.size[0]
    cell = max((width - side - 0.06) / n, 0.2)
    cell_height = min(max(CELL[1], 0.62 * cell), 0.4)
    slanted = max(text_width(title, FONT) for title in titles) > cell - 0.04
    top = side * 0.71 + 0.12 if slanted else 0.2
    right = side * 0.5 if slanted else 0.05
    lines = ["% of cases on which the row is better than the column", f"({scores.axis})"]
    size = min(fitted(line, width - 0.1, FONT, 1)[0] for line in lines)
    bottom = 0.06 + len(lines) * size * POINT * 1.25
    height = options.size[1] or top + cell_height * n + bottom
    figure, axes = chart(width, height, left=side, right=right, top=top, bottom=bottom)
    room = (width - side - right) / n - 0.03
    small = FONT * min(1.0, room / text_width("100", FONT, "bold"))
    picture = np.tile(np.array([0.96, 0.96, 0.96]), (n, n, 1))
    for row in table.to_dict("records"):
        i, j = names.index(row["method"]), names.index(row["other"])
        picture[i, j] = shade(row["rate"])
        significant = np.isfinite(row["low"]) and (row["low"] > 0.5 or row["high"] < 0.5)
        text = f"{100 * row['rate']:.0f}" if np.isfinite(row["rate"]) else "–"
        dark = abs(row["rate"] - 0.5) > 0.42 and row["rate"] > 0.5
        weight = "bold" if significant else "normal"
        axes.text(j, i, text, ha="center", va="center", fontsize=small, weight=weight, color="white" if dark else INK)
    axes.imshow(picture, aspect="auto", interpolation="none")
    axes.set_xticks(range(n), titles)
    axes.set_yticks(range(n), titles)
    axes.xaxis.tick_top()
    if slanted:
        for label in axes.get_xticklabels():
            label.set(rotation=45, ha="left", va="bottom", rotation_mode="anchor")
    axes.tick_params(length=0, pad=2)
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    figure.text(0.5, 0.03 / height, "\n".join(lines), ha="center", va="bottom", fontsize=size, linespacing=1.1)
    return figure
