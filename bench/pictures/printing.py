"""The common part of all printed pictures: sizes of columns and pages, fonts that stay text, files without a date."""

from __future__ import annotations

import io
import os
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import MissingLibrary, UsageError
from ..installing import line_of_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINT = 1 / 72  # inches
WIDTHS = {"column": 3.3, "page": 7.0}  # inches, of the usual two-column papers of computer graphics
KINDS = ("pdf", "svg", "png")
SMALLEST = 4.5  # points
DATELESS = {"pdf": {"CreationDate": None, "ModDate": None}, "svg": {"Date": None}, "png": {}}
MISSING = "Glyph"  # the start of the warning about a character that the font lacks
STYLE = {
    "pdf.fonttype": 42,  # TrueType, embedded: text can be searched, and journals accept it
    "ps.fonttype": 42,
    "svg.fonttype": "none",  # text, not outlines
    "svg.hashsalt": "detailbench",
    "font.family": "DejaVu Sans",
    "mathtext.default": "regular",
    "text.parse_math": False,  # a $ in a name is a $
    "axes.linewidth": 0.6,
}


def width_of(text: str, option: str = "--width") -> float:
    """The inches that ``3.3in``, ``8.5cm``, ``84mm``, ``column`` or ``page`` stand for.

    Raises
    ------
    UsageError
        For anything else.
    """
    if text in WIDTHS:
        return WIDTHS[text]
    found = re.fullmatch(r"([0-9]*\.?[0-9]+)\s*(in|cm|mm)?", text)
    inches = float(found[1]) / {"cm": 2.54, "mm": 25.4}.get(found[2], 1.0) if found else 0.0
    if not 0.8 <= inches <= 60:
        raise UsageError(f"{option} {text}: expected column, page, or a length like 3.3in or 84mm, up to 60 inches")
    return inches


def kind_of(path: str) -> str:
    """``pdf``, ``svg`` or ``png``, by the suffix of a file.

    Raises
    ------
    UsageError
        For another suffix, or if the folder does not exist.
    """
    kind = Path(path).suffix.lower().removeprefix(".")
    if kind not in KINDS:
        raise UsageError(f"-o {path}: expected a file that ends with .pdf, .svg or .png")
    if not Path(path).expanduser().absolute().parent.is_dir():
        raise UsageError(f"-o {path}: there is no folder {Path(path).parent}")
    return kind


def matplotlib() -> Any:
    """The module.

    Raises
    ------
    MissingLibrary
        If it is not installed.
    """
    try:
        import matplotlib as module
    except ImportError as error:
        raise MissingLibrary("matplotlib", line_of_extra("render")) from error
    return module


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches, without a window system."""
    module = matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with module.rc_context(STYLE):
        figure = Figure(figsize=(width, height), facecolor="white")
        FigureCanvasAgg(figure)
    return figure


def drawn(figure: Figure) -> None:
    """Draw a figure for its measures, without a warning about characters that the font lacks."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=MISSING)
        figure.canvas.draw()


def saved(figure: Figure, kind: str, dpi: int) -> bytes:
    """The figure as a file of a kind, the same at any time."""
    target = io.BytesIO()
    # matplotlib reads the date from here where it is set, which would be an arbitrary one
    before = os.environ.pop("SOURCE_DATE_EPOCH", None)
    try:
        with matplotlib().rc_context(STYLE), warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=MISSING)
            figure.savefig(target, format=kind, dpi=dpi, metadata=DATELESS[kind])
    finally:
        if before is not None:
            os.environ["SOURCE_DATE_EPOCH"] = before
    return target.getvalue()


def printable(text: str) -> str:
    """Text whose control characters and stray halves of characters are marks: names and messages are foreign text."""
    return "".join(c if c.isprintable() else "\ufffd" for c in text)


def text_width(text: str, size: float, weight: str = "normal") -> float:
    """The width of a line of text, in inches, at a size in points."""
    matplotlib()
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    if not text:
        return 0.0
    font = FontProperties(family="DejaVu Sans", size=size, weight=weight)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=MISSING)
        return text_to_path.get_text_width_height_descent(printable(text), font, False)[0] * POINT


def wrapped(text: str, width: float, size: float, lines: int) -> list[str]:
    """Text in at most ``lines`` lines of a width in inches; longer text ends with an ellipsis."""
    text = printable(" ".join(text.split()))
    found = [""]
    for word in re.findall(r"[^\s_\-/,(=]*[_\-/,(=]?\s*", text):
        if text_width((found[-1] + word).rstrip(), size) <= width or not found[-1]:
            found[-1] += word
        else:
            found.append(word)
    found = [line.strip() for line in found if line.strip()]
    if len(found) > lines:
        found = found[:lines]
        found[-1] = _shortened(found[-1] + "…", width, size)
    return [_shortened(line, width, size) for line in found]


def fitted(text: str, width: float, size: float, lines: int) -> tuple[float, list[str]]:
    """The largest size up to ``size`` at which text fits a width in ``lines`` lines, and the lines."""
    while True:
        for count in range(1, lines + 1):
            found = wrapped(text, width, size, count)
            if "…" not in "".join(found):
                return size, found
        if size <= SMALLEST:
            return size, found
        size -= 0.5


def _shortened(line: str, width: float, size: float) -> str:
    if text_width(line, size) <= width:
        return line
    line = line.rstrip("…")
    while len(line) > 1 and text_width(line + "…", size) > width:
        line = line[:-1]
    return line + "…"
