"""The look of a table: the columns and their order, the names of methods, the format of numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

INSIDE, BELOW, PLUSMINUS, NONE = INTERVALS = ("inside", "below", "plusminus", "none")
RANK, GIVEN = ORDERS = ("rank", "given")
OTHERS = ("rank", "front", "solved", "seconds", "peak_mb", "params")  # columns other than metrics


@dataclass(frozen=True)
class Look:
    """The user's wishes for a table; the defaults are those for the screen.

    Attributes
    ----------
    columns : tuple of str
        Metrics and :data:`OTHERS`, in the order to print them; empty for all.
    names : mapping
        New names of methods and of metrics.
    digits : int or None
        Decimals of every column; None for those that the intervals support, the same within a column.
    intervals : str
        One of :data:`INTERVALS`: ``3.2 [2.1, 4.3]``, the brackets in a line below, ``3.2 ± 1.1``, or ``3.2`` alone.
    order : str
        ``rank``, or ``given``: the methods in the order of ``methods``.
    methods : tuple of str
        As the user names them, for the order.
    caption, label : str
        Of the table; for LaTeX as they are, with their commands. Empty for ours.
    wide : bool
        A LaTeX table over both columns of a page.
    cite : bool
        Whether LaTeX cites the methods.
    """

    columns: tuple[str, ...] = ()
    names: Mapping[str, str] = field(default_factory=dict)
    digits: int | None = None
    intervals: str = INSIDE
    order: str = RANK
    methods: tuple[str, ...] = ()
    caption: str = ""
    label: str = ""
    wide: bool = False
    cite: bool = False
