"""The scores of one output as a table for the terminal."""

from __future__ import annotations

import io
from collections.abc import Mapping
from textwrap import wrap
from typing import TYPE_CHECKING, NamedTuple

from ...text import one_line
from .terminal import NOTES

if TYPE_CHECKING:
    from trimesh import Trimesh

    from ...contract.case import Case
    from ...geometry.cloud import PointCloud
    from ..conventions import Convention

BETTER = {"lower": "lower", "higher": "higher", "reference": "nearest the reference's"}


class Score(NamedTuple):
    """One score of an output."""

    value: float
    floor: float | None  # None where there is none
    better: str
    length: int = 0  # its power of length


def score_table(
    scores: Mapping[str, Score],
    case: Case,
    samples: int,
    left_out: Mapping[str, str],
    convention: Convention | None = None,
    units: str = "radius",
) -> str:
    """The scores with their floors, and below them the meaning of the numbers.

    Parameters
    ----------
    scores : mapping from names, or titles of the convention's columns
    case : Case
        Its frame and its seed are named.
    samples : int
        How many points were drawn from a surface.
    left_out : mapping from metrics to the reason why they have no score
    convention : Convention, optional
        Its digits and its notes are used.
    units : str
        ``radius`` where lengths are in radii of the reference, ``file`` where they are in the units of the files.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    digits = convention.digits if convention else {}
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 2, 0, 0), header_style="")
    table.add_column("score")
    for title in ("value", "floor"):
        table.add_column(title, justify="right")
    table.add_column("better")
    for key, (value, floor, better, _) in scores.items():
        shown = "" if floor is None else _number(floor, digits.get(key))
        table.add_row(Text(one_line(key)), _number(value, digits.get(key)), shown, BETTER[better])
    text = io.StringIO()
    Console(file=text, width=160, highlight=False).print(table)
    lines = [line.rstrip() for line in text.getvalue().splitlines()]
    radius = f"{case.frame.radius:.6g}"
    if units == "file":
        lines += ["", f"Lengths are in the units of the files; thresholds in radii of the reference: 1 is {radius}."]
    else:
        lines += ["", f"Lengths are in radii of the reference: 1 is {radius} in the files' coordinates."]
    lines += [f"Unless a metric sets another number, {samples:,} points are sampled from a surface; seed {case.seed}."]
    notes = [
        *(convention.notes(scores) if convention else ()),
        *(f"no score: {n} {why}" for n, why in left_out.items()),
    ]
    for note in notes:
        lines += wrap(note, NOTES, subsequent_indent="  ", break_long_words=False)
    return "\n".join(lines)


def _number(value: float, digits: int | None) -> str:
    """Four significant digits, or ``digits`` after the point."""
    return f"{value:.4g}" if digits is None else f"{value:.{digits}f}"


def words(geometry: PointCloud | Trimesh) -> str:
    """``1,280 faces, 642 vertices``, or ``3,000 points``."""
    from ...geometry.cloud import PointCloud

    if not isinstance(geometry, PointCloud) and len(geometry.faces):
        return f"{len(geometry.faces):,} faces, {len(geometry.vertices):,} vertices"
    points = geometry.points if isinstance(geometry, PointCloud) else geometry.vertices
    return f"{len(points):,} points"
