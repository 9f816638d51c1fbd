"""The notes below a table about its ranks: resolution, equality, and the cases that methods were run on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median
from typing import Any

from ...text import counted
from ..resolution import FEWEST, MOST

Line = dict[str, Any]  # one row of a board
FEW = 4  # more methods than these are counted, not named
RATE = "15 to 30 %"  # of tables of eight equal methods have a wrong rank interval, see docs/metrics.md


def is_ranked(lines: Sequence[Line]) -> bool:
    """Whether the methods that have these lines, all of one metric, can be ranked."""
    return len(lines) < 2 or max(line["shapes"] for line in lines) >= FEWEST


def rank_notes(metric: str, level: float) -> list[str]:
    """The meaning of a rank."""
    return [
        f"rank: by {metric}; 2-4 is the {level:.0%} confidence interval of a rank.",
        "Each interval is for its own method, with Holm's correction over its comparisons; the chance that all of "
        f"a table are right is lower: with eight equal methods, {RATE} of tables have a wrong interval (at 95 %).",
    ]


def resolution(metric: str, lines: Sequence[Line]) -> list[str]:
    """The resolution of a table's shapes by its first metric; nothing for a single method.

    Parameters
    ----------
    metric : str
    lines : sequence of dict
        Those of the metric, in their order.
    """
    shapes = max((line["shapes"] for line in lines), default=0)
    if not is_ranked(lines):
        return [f"Only {counted(shapes, 'shape')}: too few to rank methods, which takes {FEWEST}."]
    compared = [line for line in lines if line["versus_next"]]
    if not compared:
        return []
    apart = sum(line["versus_next"] == "better" for line in compared)
    said = [
        f"Resolution by {metric}: {apart} of {counted(len(compared), 'pair')} of neighbours significantly differ",
        f"{shapes} shapes detect {_size(median(line['detectable'] for line in compared))} between neighbours "
        "(median, power 80 %)",
    ]
    if lines[0]["versus_next"]:  # otherwise the first two share too few shapes to be compared
        said.append(_first_two(lines[0]))
    return [f"{'; '.join(said)}."]


def _size(ratio: float) -> str:
    if not math.isfinite(ratio):
        return "no difference"
    return f"a difference of {percent(ratio)}" if ratio < 1 else f"a factor of {1 + ratio:.2g}"


def percent(share: float) -> str:
    """``12 %`` or ``0.34 %``: two digits."""
    return f"{100 * share:.0f} %" if share >= 0.0995 else f"{100 * share:.2g} %"


def _first_two(first: Line) -> str:
    """Whether more shapes would separate the first two."""
    more = first["more_shapes"]
    if math.isnan(more):
        return "more shapes would not separate the first two"
    if more == 0:
        return "the first two are separated"
    if math.isinf(more):
        return f"more than {MOST:,} more would be needed to separate the first two"
    return f"about {more:.0f} more would separate the first two"


def equality(lines: Sequence[Line], names: Sequence[str], equal: float) -> list[str]:
    """The methods tied for first that are equal for practical purposes, and those that the shapes do not decide.

    Parameters
    ----------
    lines : sequence of dict
        Those of the first metric, in their order.
    names : sequence of str
        Of their methods.
    equal : float
        The region of practical equivalence.
    """
    if not is_ranked(lines):
        return []
    groups: dict[str, list[str]] = {"equal": [], "open": [], "less": []}
    for line, name in zip(lines[1:], names[1:], strict=True):
        alike = line["versus_first"] == "equal"
        if line["versus_first"] and line["rank_low"] == 1:
            groups["equal" if alike else "open"].append(name)
        elif alike:
            groups["less"].append(name)
    size = percent(equal)
    said = [
        (groups["equal"], f"equal within {size}"),
        (groups["open"], "too few shapes to tell"),
        (groups["less"], f"significantly worse, but by less than {size}"),
    ]
    parts = [f"{_named(members)}: {what}" for members, what in said if members]
    return [f"Compared with {names[0]}: {'; '.join(parts)}."] if parts else []


def coverage(lines: Sequence[Line], shown: Sequence[str]) -> list[str]:
    """The methods not run on all cases, and the metrics that are not defined for every output.

    Parameters
    ----------
    lines : sequence of dict
        All of a table, each with the ``label`` of its method.
    shown : sequence of str
        The metrics to report on.
    """
    lines = [line for line in lines if not shown or line["metric"] in shown]
    absent = {line["label"]: line["not_run"] for line in lines if line["not_run"]}
    notes = []
    if absent:
        some = ", ".join(f"{name} lacks {n}" for name, n in absent.items())
        some = some if len(absent) <= FEW else f"{len(absent)} methods lack some, up to {max(absent.values())}"
        notes.append(
            f"Methods were run on different cases: {some}. Each pair is compared on the cases that both were run on."
        )
    missing = {
        name: max(line["undefined"] for line in lines if line["metric"] == name)
        for name in dict.fromkeys(line["metric"] for line in lines)
    }
    parts = [f"{name} (up to {counted(n, 'output')} of a method)" for name, n in missing.items() if n]
    if parts:
        notes.append(
            f"Not defined for every output: {', '.join(parts)}. Each pair is compared where both have a score."
        )
    return notes


def front(criteria: Sequence[str], instead: bool) -> list[str]:
    """The meaning of the column ``front``, and why it replaces a rank."""
    both = " and ".join(criteria)
    why = [f"This task has no single rank: it is judged by {both}."] if instead else []
    return [*why, f"front: 1 where no other method is better in both {both}, by the means; equal is not better."]


def _named(members: Sequence[str]) -> str:
    return ", ".join(members) if len(members) <= FEW else f"{len(members)} methods"
