"""The score of a failed case: that of the worst output that takes no method at all.

With every case the engine scores two outputs that ignore the input, random points (or tiny triangles) and
nothing at all (:mod:`bench.geometry.hopeless`), and stores the worse score of the two beside the floor, as
``worst.<key>``. A case that a method failed on enters its mean and its rank with this value. It is the same for all
methods and known without running one, so that the cost of a failure does not depend on the rest of the table.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

PREFIX = "worst."
CASE = ["task", "dataset", "sensor", "split", "case", "seed"]  # the same for all methods
SAMPLES = 10_000  # for scoring hopeless outputs
STAGES = ("prepare", "method", "score")  # a case that failed in one of these was made and can be scored


def lacks_worst(row: Mapping[str, object]) -> bool:
    """Whether the worst scores of a stored row are unknown, but can be computed."""
    made = row["status"] == "ok" or row["stage"] in STAGES
    return made and not any(key.startswith(PREFIX) and value is not None for key, value in row.items())


def lent(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows, with the worst scores of each case filled in for all rows of the case.

    The row of a method that ended its process, or of an earlier version, has none; those of another method
    on the same case are the same. So is the reference's own value, if a metric should be near it. Call it before
    methods are filtered: the cost of a failure must not depend on which methods are shown.
    """
    names = [name for name in rows.columns if name.startswith(PREFIX)]
    if not names:
        return rows
    said = [json.loads(text) for text in rows["directions"].dropna().unique() if text]
    counts = {f"floor.{key}" for directions in said for key, word in directions.items() if word == "reference"}
    names += sorted(counts & set(rows.columns))
    if not rows[names].isna().any(axis=None):
        return rows
    known = rows.groupby(CASE, dropna=False)[names].transform("max")
    return rows.assign(**rows[names].fillna(known))


def worst_scores(
    hopeless: Iterable[Mapping[str, float]], perfect: Mapping[str, float], direction: Callable[[str], str]
) -> dict[str, float]:
    """The worst score of each key among those of hopeless outputs.

    Parameters
    ----------
    hopeless : iterable of mappings
        The scores of each hopeless output. Infinite ones, as distances to nothing are, cannot enter a mean and are
        left out.
    perfect : mapping
        The scores of a perfect output: the metric's floor, or the reference's own value.
    direction : function from a key to ``lower``, ``higher`` or ``reference``

    Returns
    -------
    dict
        Without the keys by which no hopeless output is worse than a perfect one: tiny equilateral triangles are of
        perfect quality, and an empty output does not intersect itself. Such a metric gives no cost of a failure.
    """
    found: dict[str, float] = {}
    for scores in hopeless:
        for key, value in scores.items():
            known, best = found.get(key), float(perfect.get(key, math.nan))
            if not math.isfinite(value) or not _worse(value, best, best, direction(key)):
                continue
            if known is None or _worse(value, known, best, direction(key)):
                found[key] = float(value)
    return found


def _worse(value: float, other: float, perfect: float, direction: str) -> bool:
    """Whether a score is worse than another one."""
    if direction == "reference":
        return abs(value - perfect) > abs(other - perfect)
    return value < other if direction == "higher" else value > other
