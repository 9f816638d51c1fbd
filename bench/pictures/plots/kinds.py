"""The kinds of plots, and their interface."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from .scores import Scores

# Name -> what it shows. The module of the name has ``table(scores, options)`` and ``draw(chart, table, scores)``.
KINDS = {
    "bars": "the mean of each method, with its interval",
    "difference": "average ranks, and the critical difference between them",
    "noise": "a metric against a parameter of the sensor",
    "pareto": "quality against time or memory, with the front",
    "profile": "the share of cases within a factor of the best",
    "time": "error against time, from traces and results",
    "wins": "how often each method is better than each other one",
}


@dataclass(frozen=True)
class Options:
    """The options of some kinds.

    Attributes
    ----------
    x : str or None
        Of ``noise``: ``sensor.PARAMETER``, ``input.KEY``, ...
    cost : str
        Of ``pareto``: ``seconds`` or ``peak_mb``.
    by : str or None
        Of ``bars``: groups of ``dataset``, ``sensor`` or ``tag``.
    """

    x: str | None = None
    cost: str = "seconds"
    by: str | None = None
    size: tuple[float, float | None] = (3.3, None)  # width and height in inches
    log: bool = False


@dataclass(frozen=True)
class Plot:
    """A finished plot.

    Attributes
    ----------
    figure : Figure
    table : DataFrame
        All drawn numbers.
    notes : list of str
        The notes on it.
    """

    figure: Figure
    table: pd.DataFrame
    notes: list[str] = field(default_factory=list)


def plot(kind: str, scores: Scores, options: Options) -> Plot:
    """A plot of a kind.

    Raises
    ------
    UsageError
        If the results lack the data of the kind.
    MissingLibrary
        If matplotlib is not installed.
    """
    from ..printing import matplotlib
    from .scores import rounded
    from .style import STYLE

    module: Any = importlib.import_module(f".{kind}", __package__)
    table = rounded(module.table(scores, options))
    notes: Mapping[str, Any] = table.attrs
    with matplotlib().rc_context(STYLE):
        figure = module.draw(table, scores, options)
    return Plot(figure, table, list(notes.get("notes", ())))
