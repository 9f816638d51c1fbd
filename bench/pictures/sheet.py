"""The sheet of a figure: tiles, titles, scores and one colour bar, put together at the size of a printed page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import UsageError
from .colors import ERROR
from .printing import POINT, STYLE, fitted, matplotlib, new_figure, printable, saved, text_width, wrapped

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .zoom import Zoom

INK, MUTED, FRAME = "#1b1e23", "#5c6470", "#20242a"
GAP, ROW_GAP = 0.035, 0.05  # inches between tiles
INSET = 0.40  # of a tile's width
BAR = 0.085  # inches: the height of the colour bar
LINES = 3  # at most, of a title
BAR_LABEL = "distance to the reference (radii)"


@dataclass(frozen=True)
class Tile:
    """One tile.

    Attributes
    ----------
    picture, inset : (height, width, 3) uint8 arrays or None
    region : ((x, y), (half width, half height)) or None
        What the inset shows, as shares of the tile, to the right and upward.
    note : str
        In a tile without a picture.
    scores : tuple of (text, whether it is the best)
        Beneath it.
    """

    picture: np.ndarray | None
    inset: np.ndarray | None = None
    region: tuple[Any, Any] | None = None
    note: str = ""
    scores: tuple[tuple[str, bool], ...] = ()
    caption: str = ""
    is_photo: bool = False


@dataclass(frozen=True)
class Layout:
    """Where everything is, in inches.

    Attributes
    ----------
    width : float
        Of the figure.
    dpi : int
        Pixels of tiles per inch.
    size : int or None
        Pixels across a tile, in place of those from ``dpi``.
    """

    width: float = 7.0
    dpi: int = 300
    size: int | None = None
    font: float = 7.0
    columns: int = 1
    aspects: tuple[float, ...] = (1.0,)
    scores: int = 0
    title_lines: int = 1

    def for_tiles(self, titles: Sequence[str], aspects: Sequence[float], scores: int) -> Layout:
        """The layout for these numbers of columns and of scores beneath each, and rows of these heights by width."""
        font = 7.0 if self.width >= 5 else 6.0
        found = replace(self, font=font, columns=len(titles), aspects=tuple(aspects), scores=scores)
        if found.tile < 0.3:
            raise UsageError(
                f"--width {self.width:g}in: {len(titles)} columns leave {found.tile:.2f} inches for a tile; expected "
                "0.3 or more: choose fewer methods with --method, or --width page"
            )
        lines = max(len(found.title(title)[1]) for title in titles)
        return replace(found, title_lines=lines)

    @property
    def line(self) -> float:
        """The height of a line of text."""
        return self.font * POINT * 1.25

    @property
    def left(self) -> float:
        """Of the names of the rows."""
        return 2.4 * self.line

    @property
    def tile(self) -> float:
        """The width of a tile."""
        return (self.width - self.left - GAP * (self.columns - 1)) / self.columns

    def title(self, text: str) -> tuple[float, list[str]]:
        """The size of a column's title and its lines."""
        return fitted(text, self.tile, self.font, LINES)

    @property
    def top(self) -> float:
        """Of the titles."""
        return self.line * self.title_lines + 0.06

    @property
    def bottom(self) -> float:
        """Of the colour bar and the text beside it."""
        return 0.07 + BAR + 2.4 * self.line

    def row_height(self, aspect: float) -> float:
        """Of a row of tiles with their scores."""
        return self.tile * aspect + self.scores * self.line + ROW_GAP

    @property
    def height(self) -> float:
        """Of the figure."""
        return self.top + sum(map(self.row_height, self.aspects)) + self.bottom

    def pixels(self, aspect: float) -> tuple[int, int]:
        """Width and height of a tile's picture."""
        across = self.size or round(self.tile * self.dpi)
        return across, max(1, round(across * aspect))

    @property
    def inset_pixels(self) -> tuple[int, int]:
        """Width and height of an inset's picture."""
        across = max(8, round(INSET * (self.size or self.tile * self.dpi)))
        return across, across


@dataclass(frozen=True)
class Sheet:
    """All that is on a figure.

    Attributes
    ----------
    titles, rows : list of str
        Of the columns, and of the cases.
    tiles : list of lists of Tile
    limit : float
        The error at the end of the colour bar; 0 where nothing has an error.
    unit : str
        Of the errors.
    scores : list of (metric, power of ten that is taken out, direction)
    zooms : list of Zoom or None
        What the insets of each row show.
    """

    titles: list[str]
    rows: list[str]
    tiles: list[list[Tile]]
    limit: float
    unit: str
    layout: Layout
    scores: list[tuple[str, int, str]] = field(default_factory=list)
    zooms: list[Zoom | None] = field(default_factory=list)

    def save(self, kind: str) -> bytes:
        """The figure as a file: ``pdf``, ``svg`` or ``png``.

        Raises
        ------
        MissingLibrary
            When matplotlib is not installed.
        """
        size, tile = self.layout.size, self.layout.tile
        return saved(self.figure(), kind, round(size / tile) if size and kind == "png" else self.layout.dpi)

    def figure(self) -> Figure:
        """The figure, as matplotlib has it."""
        with matplotlib().rc_context(STYLE):
            return self._figure()

    def _figure(self) -> Figure:
        place = self.layout
        figure = new_figure(place.width, place.height)
        for j, title in enumerate(self.titles):
            size, lines = place.title(title)
            x = place.left + j * (place.tile + GAP) + place.tile / 2
            _text(figure, x, place.height - place.top + 0.06, "\n".join(lines), size, va="baseline")
        y = place.height - place.top
        size = self._size_of_names()
        for name, tiles, aspect in zip(self.rows, self.tiles, place.aspects, strict=True):
            height = place.tile * aspect
            _text(figure, place.left - 0.045, y - height / 2, name, size, rotation=90, ha="right", va="center")
            corner = best_corner(tiles, aspect)
            for j, tile in enumerate(tiles):
                x = place.left + j * (place.tile + GAP)
                self._tile(figure, tile, (x, y - height, place.tile, height), corner)
            y -= place.row_height(aspect)
        self._bar(figure)
        return figure

    def _size_of_names(self) -> float:
        """The size at which all names of rows fit beside them."""
        font = self.layout.font
        sizes = [
            font * self.layout.tile * aspect / max(text_width(line, font), 1e-3)
            for name, aspect in zip(self.rows, self.layout.aspects, strict=True)
            for line in name.split("\n")
        ]
        return max(min([font, *sizes]), 3.5)

    def _tile(self, figure: Figure, tile: Tile, box: tuple[float, float, float, float], corner: int) -> None:
        axes = _axes(figure, box)
        x, y, width, height = box
        if tile.picture is None:
            axes.set_facecolor("#f4f5f6")
            size = self.layout.font * 0.86
            lines = wrapped(tile.note or "nothing to show", width * 0.9, size, max(1, int(height / self.layout.line)))
            _text(figure, x + width / 2, y + height / 2, "\n".join(lines), size, color=MUTED, va="center")
        elif tile.is_photo:
            axes.imshow(tile.picture, aspect="equal", interpolation="antialiased")
        else:
            axes.imshow(tile.picture, aspect="auto", extent=(0, 1, 0, 1), interpolation="none")
        if tile.caption:
            _text(figure, x + width / 2, y + 0.02, tile.caption, self.layout.font * 0.8, color=MUTED, va="bottom")
        if tile.inset is not None and tile.region is not None:
            self._inset(figure, axes, tile, box, corner)
        for i, (score, best) in enumerate(tile.scores):
            weight = "bold" if best else "normal"
            _text(figure, x + width / 2, y - i * self.layout.line - 0.015, score, self.layout.font, weight=weight)

    def _inset(
        self, figure: Figure, axes: Axes, tile: Tile, box: tuple[float, float, float, float], corner: int
    ) -> None:
        """The place that is shown larger, framed in the tile, and the inset in a corner."""
        from matplotlib.patches import Rectangle

        assert tile.region is not None and tile.inset is not None
        (x, y), (half_width, half_height) = tile.region
        low = np.clip([x - half_width, y - half_height], 0.004, 1)
        high = np.clip([x + half_width, y + half_height], 0, 0.996)
        axes.set_xlim(0, 1)
        axes.set_ylim(0, 1)
        axes.add_patch(Rectangle(low, *(high - low), fill=False, edgecolor=FRAME, linewidth=0.5))
        side = INSET * box[2]
        left = box[0] + (box[2] - side if corner in (1, 3) else 0)
        bottom = box[1] + (box[3] - side if corner in (2, 3) else 0)
        inner = _axes(figure, (left, bottom, side, side))
        inner.imshow(tile.inset, aspect="auto", extent=(0, 1, 0, 1), interpolation="none")
        inner.add_patch(Rectangle((0, 0), 1, 1, fill=False, edgecolor=FRAME, linewidth=1.0))

    def _bar(self, figure: Figure) -> None:
        """The colour bar, and the meaning of the numbers beneath the tiles."""
        place = self.layout
        y = place.bottom - 0.07 - BAR
        edge = place.width
        if self.limit > 0:
            width = min(2.4, (place.width - place.left) * 0.45)
            x = edge = place.width - width - 0.25
            axes = _axes(figure, (x, y, width, BAR))
            axes.imshow(ERROR[None], aspect="auto", extent=(0, 1, 0, 1), interpolation="none")
            for share in (0, 0.5, 1):
                text = f"{self.limit * share:.3g}"
                _text(figure, x + share * width, y - 0.02, f"≥ {text}" if share == 1 else text, place.font)
            size, _ = fitted(BAR_LABEL, width, place.font, 1)
            _text(figure, x + width / 2, y - 0.02 - place.line, BAR_LABEL, size)
        if self.scores:
            words = "; ".join(_words(*score) for score in self.scores)
            size, lines = fitted(f"Beneath: {words}", edge - place.left - 0.12, place.font, 3)
            _text(figure, place.left, y + BAR, "\n".join(lines), size, ha="left", color=MUTED)


def best_corner(tiles: Sequence[Tile], aspect: float) -> int:
    """The corner for the insets of a row that hides least: 0 and 1 are below left and right, 2 and 3 above.

    A corner that hides the place which is shown larger is the last choice.
    """
    cost = np.zeros(4)
    for tile in tiles:
        if tile.picture is None or tile.inset is None or tile.region is None:
            continue
        height, width = tile.picture.shape[:2]
        side, (x, y), (half_x, half_y) = round(INSET * width), *tile.region
        for corner in range(4):
            columns = slice(width - side, None) if corner in (1, 3) else slice(0, side)
            lines = slice(0, side) if corner in (2, 3) else slice(max(0, height - side), None)
            cost[corner] += (tile.picture[lines, columns] < 250).any(axis=2).mean()
            across, up = INSET, INSET / aspect
            apart_x = x - half_x > across if corner in (0, 2) else x + half_x < 1 - across
            apart_y = y - half_y > up if corner in (0, 1) else y + half_y < 1 - up
            cost[corner] += 0 if apart_x or apart_y else 10
    return min((1, 3, 0, 2), key=lambda corner: round(float(cost[corner]), 6))


def _words(metric: str, exponent: int, direction: str) -> str:
    arrow = {"lower": " ↓", "higher": " ↑"}.get(direction, "")
    return f"{metric}{arrow} (1e{exponent})" if exponent else f"{metric}{arrow}"


def _axes(figure: Figure, box: tuple[float, float, float, float]) -> Axes:
    width, height = figure.get_size_inches()
    axes = figure.add_axes((box[0] / width, box[1] / height, box[2] / width, box[3] / height))
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(False)
    return axes


def _text(figure: Figure, x: float, y: float, text: str, size: float, **style: Any) -> None:
    width, height = figure.get_size_inches()
    style = {"ha": "center", "va": "top", "color": INK, "linespacing": 1.1} | style
    text = "\n".join(map(printable, text.split("\n")))
    how: dict[str, Any] = {"fontsize": size, **style}
    figure.text(x / width, y / height, text, **how)
