"""Means of methods with their intervals, best first; side by side for each dataset, sensor or tag if wanted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from ..printing import POINT, new_figure, printable, text_width
from .style import COLORS, FONT, GRID, INK, name_width

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .kinds import Options
    from .scores import Scores

THICK = 0.17  # inches: from bar to bar


def table(scores: Scores, options: Options) -> pd.DataFrame:
    """One row for each group and method: mean, interval, and how many cases were solved."""
    board = scores.board(by=options.by or "task")
    varies = [name for name in ("dataset", "sensor") if board[name].nunique() > 1]
    group = board[varies].agg(", ".join, axis=1) if varies else pd.Series("", board.index)
    shown = pd.DataFrame(
        {
            "group": group,
            "method": board["label"],
            "title": board["label"].map(scores.titles),
            **scores.means(board),
        }
    )
    overall = scores.board().reset_index(drop=True)
    place = {label: i for i, label in enumerate(scores.order if scores.is_ordered else overall["label"])}
    shown = shown.assign(__place=shown["method"].map(place)).sort_values(["group", "__place"], kind="stable")
    return shown.drop(columns="__place").reset_index(drop=True)


def draw(table: pd.DataFrame, scores: Scores, options: Options) -> Figure:
    """Horizontal bars; a panel for each group."""
    groups, methods = list(dict.fromkeys(table["group"])), list(dict.fromkeys(table["method"]))
    left, bottom, gap = name_width(scores.titles) + 0.12, 0.4, 0.14
    top = 0.22 if len(groups) > 1 else 0.06
    width = options.size[0]
    height = options.size[1] or bottom + top + THICK * len(methods)
    figure = new_figure(width, height)
    each = (width - left - 0.06 - gap * (len(groups) - 1)) / len(groups)
    for i, group in enumerate(groups):
        box = ((left + i * (each + gap)) / width, bottom / height, each / width, (height - bottom - top) / height)
        axes = figure.add_axes(box)
        _panel(axes, table[table["group"] == group], methods, each)
        axes.set_yticks(range(len(methods)), [scores.titles[m] for m in methods] if i == 0 else [""] * len(methods))
        if group:
            group = printable(group)
            axes.set_title(group, fontsize=min(FONT, FONT * each / max(text_width(group, FONT), 1e-3)), pad=3)
    ends = np.array([axes.get_xlim() for axes in figure.axes])
    for axes in figure.axes:  # panels are compared with each other
        axes.set_xlim(ends[:, 0].min(), ends[:, 1].max())
    middle = (left + (width - left) / 2) / width
    figure.text(middle, 0.03 / height, scores.axis, ha="center", va="bottom", fontsize=FONT)
    return figure


def _panel(axes: Axes, part: pd.DataFrame, methods: list[str], width: float) -> None:
    part = part.set_index("method").reindex(methods)
    places = np.arange(len(methods))
    axes.barh(places, part["mean"], height=0.66, color=COLORS[0], alpha=0.75, linewidth=0)
    low, high = part["low"].fillna(part["mean"]), part["high"].fillna(part["mean"])
    axes.hlines(places, low, high, color=INK, linewidth=0.9)
    axes.vlines([*low, *high], np.tile(places - 0.16, 2), np.tile(places + 0.16, 2), color=INK, linewidth=0.9)
    axes.set_ylim(len(methods) - 0.45, -0.55)
    values = [v for v in (*low, *high, *part["mean"], 0.0) if np.isfinite(v)]
    begin, end = min(values), max(values)
    texts = [f"{value:.3g}" if np.isfinite(value) else "solved nothing" for value in part["mean"]]
    room = min(max((text_width(text, FONT * 0.92) for text in texts), default=0) + 0.08, 0.6 * width)
    axes.set_xlim(begin, end + (end - begin) * room / (width - room) if end > begin else 1)
    for y, text, x in zip(places, texts, high.fillna(0.0), strict=True):
        axes.annotate(
            text, (max(x, 0.0), y), (3, 0), textcoords="offset points", fontsize=FONT * 0.92, va="center", color=INK
        )
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color=GRID, linewidth=0.5)
    axes.locator_params(axis="x", nbins=max(2, int(width / (5 * FONT * POINT))))
