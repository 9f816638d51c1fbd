"""The look of plots: colours, markers and lines that survive a grey print; names at the lines, without overlap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .. import printing
from ..colors import OKABE_ITO
from ..printing import POINT, drawn, new_figure, text_width

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, MUTED, GRID = "#1b1e23", "#5c6470", "#dfe2e6"
FONT = 7.0
# Yellow is too light for a line on white paper: it comes after black.
COLORS = (*OKABE_ITO[:6], OKABE_ITO[7], OKABE_ITO[6])
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "h")
LINES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (4, 1, 1, 1)), (0, (2, 1)), (0, (6, 1, 1, 1, 1, 1)))
STYLE = printing.STYLE | {
    "font.size": FONT,
    "axes.labelsize": FONT,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.labelsize": FONT * 0.92,
    "ytick.labelsize": FONT * 0.92,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "axes.unicode_minus": True,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.6,
    "axes.axisbelow": True,
}


class Look(NamedTuple):
    """Of one method, the same in all plots of the same methods."""

    color: str
    marker: str
    line: Any


def looks(names: Sequence[str]) -> dict[str, Look]:
    """A look for each method, by its place; no two are equal for 264 methods."""
    n = len(COLORS)
    return {
        name: Look(COLORS[i % n], MARKERS[i % len(MARKERS)], LINES[(i + i // n) % len(LINES)])
        for i, name in enumerate(names)
    }


def chart(
    width: float, height: float, *, left: float = 0.52, right: float = 0.1, bottom: float = 0.42, top: float = 0.1
) -> tuple[Figure, Axes]:
    """A figure with one diagram; all lengths in inches."""
    figure = new_figure(width, height)
    box = (left / width, bottom / height, (width - left - right) / width, (height - bottom - top) / height)
    axes = figure.add_axes(box)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.grid(color=GRID, linewidth=0.5)
    return figure, axes


def settle(axes: Axes) -> None:
    """Move the left edge and the lower one of a diagram so that its numbers and words just fit."""
    from matplotlib.figure import Figure

    figure = axes.figure
    assert isinstance(figure, Figure)  # not a part of one
    drawn(figure)
    canvas: Any = figure.canvas  # of Agg, whose renderer the base class does not name
    renderer, edge, place = canvas.get_renderer(), 0.03 * figure.dpi, axes.get_window_extent()
    words = [box for axis in (axes.yaxis, axes.xaxis) if (box := axis.get_tightbbox(renderer)) is not None]
    left = place.x0 - min((box.x0 for box in words), default=place.x0) + edge
    bottom = place.y0 - min((box.y0 for box in words), default=place.y0) + edge
    wide, high = np.array(figure.get_size_inches()) * figure.dpi
    axes.set_position((left / wide, bottom / high, (place.x1 - left) / wide, (place.y1 - bottom) / high))
    drawn(figure)


def name_width(titles: Mapping[str, str]) -> float:
    """The width of the names, in inches."""
    return max((text_width(title, FONT) for title in titles.values()), default=0.0)


def spread(wanted: np.ndarray, gap: float, low: float, high: float) -> np.ndarray:
    """Places near the wanted ones, in their order, at least ``gap`` apart and between ``low`` and ``high``.

    The places with the least squares of their moves: neighbours that are too close become a block around their mean
    (the pool of adjacent violators). If there is no room for all, they are evenly spaced.
    """
    n = len(wanted)
    if n == 0:
        return np.zeros(0)
    if (n - 1) * gap >= high - low:
        places = np.linspace(low, high, n)
        found = np.empty(n)
        found[np.argsort(wanted, kind="stable")] = places
        return found
    order = np.argsort(wanted, kind="stable")
    target = np.clip(np.asarray(wanted, dtype=float)[order], low, high) - gap * np.arange(n)
    blocks: list[list[float]] = []  # sum and count
    for value in target:
        blocks.append([value, 1])
        while len(blocks) > 1 and blocks[-2][0] / blocks[-2][1] > blocks[-1][0] / blocks[-1][1]:
            total, count = blocks.pop()
            blocks[-1][0] += total
            blocks[-1][1] += count
    level = np.concatenate([np.full(int(count), total / count) for total, count in blocks])
    level = np.clip(level, low, high - gap * (n - 1))
    found = np.empty(n)
    found[order] = level + gap * np.arange(n)
    return found


def names_at_ends(
    axes: Axes,
    ends: Mapping[str, tuple[float, float]],
    titles: Mapping[str, str],
    look: Mapping[str, Look],
    above: Mapping[str, float] | None = None,
) -> None:
    """The name of each line at its right end, outside of the diagram; thin lines lead to those that had to move.

    Parameters
    ----------
    axes : Axes
        With its final limits.
    ends : mapping
        The last point of each line, in data coordinates.
    titles, look : mappings
        From the same keys.
    above : mapping, optional
        Of lines that end at the same place, that with the larger number is named above the other.
    """
    figure = axes.figure
    settle(axes)
    height = axes.get_window_extent().height / figure.dpi
    names = sorted(ends, key=lambda name: (above or {}).get(name, 0.0))
    to_axes = axes.transAxes.inverted()
    points = np.array([to_axes.transform(axes.transData.transform(ends[name])) for name in names])
    points = np.clip(points, 0, 1)
    places = spread(points[:, 1] * height, FONT * POINT * 1.15, 0.0, height) / height
    inch = 1 / (axes.get_window_extent().width / figure.dpi)
    for name, (x, y), place in zip(names, points, places, strict=True):
        elbow, text = 1 + 0.04 * inch, 1 + 0.16 * inch
        axes.plot(
            [min(x, 1), elbow, text - 0.02 * inch], [y, y, place], color=look[name].color, linewidth=0.5,
            transform=axes.transAxes, clip_on=False, solid_capstyle="butt",
        )  # fmt: skip
        axes.text(
            text, place, titles[name], transform=axes.transAxes, color=INK, fontsize=FONT, va="center", ha="left",
            clip_on=False,
        )  # fmt: skip


class Box(NamedTuple):
    """A rectangle in inches."""

    left: float
    bottom: float
    right: float
    top: float

    def overlap(self, other: Box) -> float:
        """The area that two rectangles share."""
        wide = min(self.right, other.right) - max(self.left, other.left)
        high = min(self.top, other.top) - max(self.bottom, other.bottom)
        return max(wide, 0) * max(high, 0)


def names_at_points(
    axes: Axes,
    points: Mapping[str, tuple[float, float]],
    titles: Mapping[str, str],
    lines: Sequence[np.ndarray] = (),
) -> list[Box]:
    """The name of each point beside it, where it hides no point, no line, no other name and stays in the diagram.

    Parameters
    ----------
    axes : Axes
        With its final limits.
    points : mapping
        In data coordinates.
    titles : mapping
        From the same keys.
    lines : sequence of (n, 2) arrays
        Other drawn lines, in data coordinates.

    Returns
    -------
    list of Box
        The places of the names, in inches from the diagram's lower left corner.
    """
    figure = axes.figure
    settle(axes)
    size = np.array(axes.get_window_extent().size) / figure.dpi
    to_axes = axes.transAxes.inverted()

    def inches(xy: Any) -> np.ndarray:
        return to_axes.transform(axes.transData.transform(xy)) * size

    at = {name: inches(xy) for name, xy in points.items()}
    dot, line = 0.045, FONT * POINT
    taken = [Box(x - dot, y - dot, x + dot, y + dot) for x, y in at.values()]
    for path in lines:
        taken += _along(inches(path))
    inside = Box(0.0, 0.0, float(size[0]), float(size[1]))
    placed = []
    for name in sorted(at, key=lambda name: -at[name][1]):
        (x, y), width = at[name], text_width(titles[name], FONT)
        best = min(_candidates(x, y, width, line), key=lambda box: _cost(box, taken, inside))
        taken.append(best)
        placed.append(best)
        axes.text(
            best.left / size[0], (best.bottom + best.top) / 2 / size[1], titles[name], transform=axes.transAxes,
            fontsize=FONT, va="center", ha="left", clip_on=False,
        )  # fmt: skip
        near = (np.clip(x, best.left, best.right), np.clip(y, best.bottom, best.top))
        if np.hypot(near[0] - x, near[1] - y) > 0.1:  # inches
            ends = np.array([[x, y], near]) / size
            axes.plot(*ends.T, color=MUTED, linewidth=0.4, transform=axes.transAxes, zorder=1)
    return placed


def _along(path: np.ndarray) -> list[Box]:
    """Small boxes along a line, (n, 2) in inches."""
    boxes = []
    for a, b in zip(path[:-1], path[1:], strict=True):
        if np.isfinite([a, b]).all():
            steps = max(2, int(np.ceil(np.linalg.norm(b - a) / 0.03)))
            boxes += [Box(x - 0.01, y - 0.01, x + 0.01, y + 0.01) for x, y in np.linspace(a, b, min(steps, 200))]
    return boxes


def _candidates(x: float, y: float, width: float, line: float) -> list[Box]:
    """Places for a name around a point: near ones first, right, left, above and below."""
    found = []
    for away in (0.06, 0.12, 0.2, 0.3, 0.42):
        for across, up in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            left = x + (away if across > 0 else -away - width if across < 0 else -width / 2)
            middle = y + up * (away + line / 2 if across == 0 else away)
            found.append(Box(left, middle - line / 2, left + width, middle + line / 2))
    return found


def _cost(box: Box, taken: Sequence[Box], inside: Box) -> float:
    area = (box.right - box.left) * (box.top - box.bottom)
    return sum(box.overlap(other) for other in taken) + 3 * (area - box.overlap(inside))


def plain_log(axis: Any) -> None:
    """Numbers as 0.01 and 20 rather than as powers of ten, on a logarithmic axis, with enough of them."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = sorted(axis.get_view_interval())
    decades = np.log10(high / low)
    choices = ((3.0, (1.0,)), (1.5, (1.0, 3.0)), (0.8, (1.0, 2.0, 5.0)), (-1.0, tuple(range(1, 10))))
    subs = next(subs for least, subs in choices if decades > least)
    axis.set_major_locator(LogLocator(base=10, subs=subs, numticks=20))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.10g}"))
    axis.set_minor_formatter(NullFormatter())
    if decades < 0.5:
        from matplotlib.ticker import MaxNLocator, NullLocator

        axis.set_major_locator(MaxNLocator(5))
        axis.set_minor_locator(NullLocator())
