"""The highlighted means of a table: the best one, those that are not significantly worse, and the second best.

These are two statements. The best mean is the first in the order of the printed numbers. Whether another
method is worse is a question of the paired test behind the ranks: a mean can be behind on eight shapes by chance, and
a mean close by can be significantly worse. Tables therefore print the best mean bold and mark those that share the
first rank.
"""

from __future__ import annotations

import numpy as np

from .statistics import SAME

BEST, TIED, SECOND = "best", "tied", "second"


def places(badness: np.ndarray, first: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """The place of each mean of one table.

    Parameters
    ----------
    badness : (k, m) array
        The means of k methods by m metrics, such that lower is better; NaN where there is none.
    first : (k, m) bool array
        Whether the interval of the rank begins with 1.
    whole : (k, m) bool array
        Whether the method solved all of its cases: one that failed anywhere is neither the best nor the second best.

    Returns
    -------
    (k, m) array of str
        ``best``: the best mean of those that share the first rank; ``tied``: the rest of them; ``second``: the second
        best mean of three or more; ``tied second``: both; empty: none of these.
    """
    able = whole & np.isfinite(badness)
    best = _lowest(badness, able & first)
    second = _lowest(badness, able & ~best)
    second &= (best.sum(axis=0) == 1) & (able.sum(axis=0) > 2)
    tied = first & ~best & np.isfinite(badness) & best.any(axis=0)
    found = np.full(badness.shape, "", dtype=object)
    found[best], found[tied], found[second], found[tied & second] = BEST, TIED, SECOND, f"{TIED} {SECOND}"
    return found


def _lowest(values: np.ndarray, among: np.ndarray) -> np.ndarray:
    """Which values are the lowest of their column, among those in ``among``; equal up to rounding counts as equal."""
    shown = np.where(among, values, np.inf)
    least = shown.min(axis=0, initial=np.inf)
    with np.errstate(invalid="ignore"):
        return among & (abs(shown - least) <= SAME * (abs(shown) + abs(least)))
