"""Two orders of the methods, printed side by side, with Kendall's tau below."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pandas as pd

from ...text import counted
from ..agreement import Agreement, Tau, as_records
from ..naming import naming
from . import check_format
from .cells import csv
from .grids import Grid, rendered
from .labels import setup, shown_setup, with_setup
from .numbers import unit_exponent, with_interval
from .table import title_of
from .terminal import ARROWS


def render_agreement(
    found: Sequence[Agreement], format: str = "terminal", *, level: float = 0.95, width: int = 120
) -> str:
    """The orders of :func:`bench.ranking.agreement.agreement` as text.

    Parameters
    ----------
    found : sequence of Agreement
    format : str
        terminal, markdown, latex, or csv (all lines in full precision).
    level : float
        Of the intervals, for the notes.
    width : int
        Of the terminal, for the notes.

    Raises
    ------
    UsageError
        For an unknown format.
    """
    check_format(format)
    if format == "csv":
        return csv(pd.DataFrame(as_records(list(found))))
    grids = [grid for one in found for grid in grids_of(one, level)]
    return rendered(grids, format, width)


def grids_of(one: Agreement, level: float = 0.95) -> list[Grid]:
    """The methods, tau of all and of each sensor, and tau of each family."""
    title = title_of(one.task, f"{one.sides[0]} | {one.sides[1]}", "", one.split)
    grids = [_methods(one, title, level), _taus(one, f"{title}: agreement", level)]
    return [*grids, _families(one, f"{title}: families")] if len(one.families) > 1 else grids


def names_of(one: Agreement) -> list[str]:
    """The names of the methods, in the order of their lines."""
    lines = one.methods.assign(metric=one.metric).to_dict("records")
    shown = shown_setup(lines)
    called = naming((line["method"], line["variant"]) for line in lines).labels
    return [with_setup(called[line["method"], line["variant"]], setup(line, shown)) for line in lines]


def _methods(one: Agreement, title: str, level: float) -> Grid:
    lines = one.methods.to_dict("records")
    exponent = unit_exponent(line[f"mean_{n}"] for line in lines for n in (1, 2))
    unit = f" (1e{exponent})" if exponent else ""
    metric = f"{one.metric} {ARROWS['difference' if one.better == 'reference' else one.better]}{unit}"
    head = ["method"]
    for side in one.sides:
        head += [f"{side}: place (rank)", metric, "solved"]
    cells = []
    for name, line in zip(names_of(one), lines, strict=True):
        row = [name]
        for n in (1, 2):
            value, low, high = (line[f"{key}_{n}"] for key in ("mean", "ci_low", "ci_high"))
            mean = with_interval(value, low, high, exponent)
            row += [_place(line, n), mean, f"{line[f'solved_{n}']}/{line[f'planned_{n}']}"]
        cells.append(tuple(row))
    notes = [
        f"place: by the mean; in brackets the {level:.0%} confidence interval of the rank, on each side by itself.",
        f"mean [{level:.0%} interval over shapes].",
    ]
    if one.left_out:
        notes.append(f"Left out: {counted(one.left_out, 'unit')} not planned for all of these methods.")
    return Grid(title, tuple(head), tuple(cells), tuple(notes))


def _place(line: dict, n: int) -> str:
    low, high = line[f"rank_low_{n}"], line[f"rank_high_{n}"]
    if pd.isna(low):
        return f"{line[f'place_{n}']} (-)"
    return f"{line[f'place_{n}']} ({low if low == high else f'{low}-{high}'})"


def _taus(one: Agreement, title: str, level: float) -> Grid:
    head = ("cases", "tau", f"{level:.0%} interval", "spread", "agree", "reverse", "open", "shapes")
    lines = [
        (
            "all" if tau.part == "all" else tau.name,
            _tau(tau.tau),
            f"[{_tau(tau.low)}, {_tau(tau.high)}]",
            f"[{_tau(tau.spread_low)}, {_tau(tau.spread_high)}]",
            *map(str, (tau.agree, tau.reverse, tau.open)),
            f"{tau.shapes} | {tau.shapes_other}",
        )
        for tau in one.taus
        if tau.part != "family"
    ]
    names = names_of(one)
    against = [f"{names[a]} before {names[b]}" for a, b in one.reversed]
    said = (
        f"Significantly reversed: on {one.sides[0]} {'; '.join(against)}; on {one.sides[1]} the other way."
        if against
        else ("No pair is significantly reversed.")
    )
    halves = " and ".join(f"{_tau(tau)} ({side})" for tau, side in zip(one.halves, one.sides, strict=True))
    return Grid(
        title,
        head,
        tuple(lines),
        (
            said,
            f"Tau of two random halves of one set, the median: {halves}. Sets of so few shapes do not agree better.",
            "tau: Kendall's tau-b of the two orders: 1 the same, 0 unrelated, -1 reversed.",
            f"{level:.0%} interval: from the pairs of methods that both sets order significantly, alike (agree) or the "
            "other way (reverse); the others (open) may be either.",
            f"spread: the middle {level:.0%} of tau over resampled shapes; no confidence interval.",
        ),
    )


def _families(one: Agreement, title: str) -> Grid:
    """The families, first that without which the agreement is best."""
    alone = {tau.name: tau for tau in one.taus if tau.part == "family" and not tau.without}
    without = {tau.name: tau for tau in one.taus if tau.without}
    order = sorted(without, key=lambda name: (-_or_least(without[name]), _or_least(alone[name]), name))
    lines = tuple((n, _tau(alone[n].tau), _tau(without[n].tau), str(alone[n].shapes)) for n in order)
    side = one.sides[1]
    return Grid(
        title,
        ("family", f"tau of it alone with {side}", "tau of the others", "shapes"),
        lines,
        (f"First those that make the order least like that on {side}: without them tau is highest.",),
    )


def _or_least(tau: Tau) -> float:
    return tau.tau if math.isfinite(tau.tau) else -2.0


def _tau(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "-"
