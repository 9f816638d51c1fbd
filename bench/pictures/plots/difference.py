"""Average ranks, with a bar over those that do not differ significantly: a critical-difference diagram.

J. Demšar, "Statistical Comparisons of Classifiers over Multiple Data Sets", *JMLR* 7, 2006; the numbers are those of
:func:`bench.ranking.comparison.average_ranks`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from ...errors import UsageError
from ...ranking.comparison import average_ranks
from ...ranking.leaderboard import unit_scores
from ..printing import POINT, fitted
from .style import FONT, INK, MUTED, chart, name_width
from .wins import clusters

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .kinds import Options
    from .scores import Scores


def table(scores: Scores, options: Options) -> pd.DataFrame:
    """One row for each method, best first: its average rank, the test, and the groups that it belongs to."""
    units = unit_scores(scores.pooled(), scores.metric)
    names = scores.label_of(units.contenders)
    found = average_ranks(units.values, units.planned, clusters(units.units), scores.level)
    if found.blocks < 2 or len(names) < 2:
        raise UsageError(
            f"average ranks need two methods and two shapes on which all of them were run; there are {len(names)} and "
            f"{found.blocks}"
        )
    order = np.argsort(found.ranks, kind="stable")
    ranks = found.ranks[order]
    groups = cliques(ranks, found.critical)
    member = [" ".join(str(g + 1) for g, (a, b) in enumerate(groups) if a <= i <= b) for i in range(len(ranks))]
    table = pd.DataFrame(
        {
            "method": [names[i] for i in order],
            "title": [scores.titles[names[i]] for i in order],
            "metric": scores.metric,
            "average_rank": ranks,
            "groups": member,
            "critical_difference": found.critical,
            "shapes": found.blocks,
            "friedman": found.statistic,
            "p": found.p,
        }
    )
    significant = found.p < 1 - scores.level
    verdict = "the methods differ" if significant else "it does not show that the methods differ at all"
    table.attrs["notes"] = [
        f"critical difference {found.critical:.3g} of {found.blocks} shapes (Nemenyi, {scores.level:.0%})",
        f"Friedman's test: p = {found.p:.2g}: {verdict}",
    ]
    return table


def cliques(ranks: np.ndarray, critical: float) -> list[tuple[int, int]]:
    """The largest groups of neighbours, first and last, whose ranks differ by less than the critical difference.

    Parameters
    ----------
    ranks : (k,) array
        In rising order.
    critical : float

    Returns
    -------
    list of (first, last)
        Groups of two or more, none within another.
    """
    found: list[tuple[int, int]] = []
    for first in range(len(ranks)):
        last = int(np.searchsorted(ranks, ranks[first] + critical, side="left")) - 1
        if last > first and (not found or last > found[-1][1]):
            found.append((first, last))
    return found


def draw(table: pd.DataFrame, scores: Scores, options: Options) -> Figure:
    """Ranks on a line, best on the left; names at both sides; bars join ranks that do not differ significantly."""
    ranks, n = table["average_rank"].to_numpy(), len(table)
    critical = float(table["critical_difference"].iloc[0])
    groups = cliques(ranks, critical)
    line = FONT * POINT * 1.5
    half = math.ceil(n / 2)
    side = name_width(scores.titles) + 0.42
    first, bars = 0.52, 0.085 * len(groups) + 0.08
    width = options.size[0]
    size, words = fitted(f"average rank by {scores.axis}", width - 0.1, FONT, 2)
    height = options.size[1] or first + bars + (half + len(words)) * line + 0.06
    figure, axes = chart(width, height, left=0, right=0, top=0, bottom=0)
    axes.set_axis_off()
    axes.grid(False)
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)  # inches from the top
    low, high = 1.0, float(n)

    def place(rank: float) -> float:
        return side + (rank - low) / max(high - low, 1e-9) * (width - 2 * side)

    _scale(axes, place, n, critical, first)
    axes.text(width / 2, height - 0.03, "\n".join(words), ha="center", va="bottom", fontsize=size)
    for number, (a, b) in enumerate(groups):
        y = first + 0.09 + 0.085 * number
        ends = [place(ranks[a]) - 0.03, place(ranks[b]) + 0.03]
        axes.plot(ends, [y, y], color=INK, linewidth=2.4, solid_capstyle="butt")
    for i, title in enumerate(table["title"]):
        is_left = i < half
        y = first + bars + line * ((i if is_left else n - 1 - i) + 0.5)
        edge, align = (side - 0.06, "right") if is_left else (width - side + 0.06, "left")
        axes.plot([place(ranks[i])] * 2 + [edge], [first, y, y], color=MUTED, linewidth=0.7)
        text = f"{title}  {ranks[i]:.2f}" if is_left else f"{ranks[i]:.2f}  {title}"
        axes.text(edge + (-0.03 if is_left else 0.03), y, text, ha=align, va="center", fontsize=FONT)
    return figure


def _scale(axes: Axes, place: Callable[[float], float], n: int, critical: float, y: float) -> None:
    """The line of ranks with its ticks, and the critical difference above it."""
    axes.plot([place(1), place(n)], [y, y], color=INK, linewidth=0.9)
    step = max(1, math.ceil((n - 1) / 8))
    for rank in range(1, n + 1, step):
        axes.plot([place(rank)] * 2, [y - 0.04, y], color=INK, linewidth=0.9)
        axes.text(place(rank), y - 0.055, str(rank), ha="center", va="bottom", fontsize=FONT)
    length = min(place(1 + critical), place(n)) - place(1)
    if critical <= n - 1:
        axes.plot([place(1), place(1) + length], [y - 0.27] * 2, color=INK, linewidth=0.9)
        for x in (place(1), place(1) + length):
            axes.plot([x, x], [y - 0.30, y - 0.24], color=INK, linewidth=0.9)
    text = f"critical difference {critical:.2f}" + ("" if critical <= n - 1 else ": all could be equal")
    axes.text(place(1), y - 0.32, text, ha="left", va="bottom", fontsize=FONT)
