"""How fast this machine is right now: a short fixed workload, timed just before a method is called.

Times of two runs may come from two machines, or from one at two times: another processor, another clock rate,
neighbours. Divided by the time of a fixed workload on the same processors a moment before, they can be compared.
"""

from __future__ import annotations

import functools
import time

import numpy as np

REPEATS = 5  # of which the median is taken: one alone may be interrupted
POINTS = 1500  # one turn takes two or three milliseconds: much less than any case takes to be made and scored


@functools.lru_cache(maxsize=1)
def _points() -> np.ndarray:
    """(n, 3) points that fill the unit cube evenly: Weyl's sequence, which needs no generator."""
    return np.outer(np.arange(1, POINTS + 1), [2**0.5, 3**0.5, 5**0.5]) % 1.0


def _work(points: np.ndarray) -> float:
    """One turn of what geometry processing does: neighbours, sorting and plain Python. One thread, no BLAS."""
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(points).query(points, k=4)
    total = float(np.sort(distances, axis=None).sum())
    for i in range(5000):
        total += i % 7
    return total


def reference_seconds() -> float:
    """Processor seconds of the fixed workload on the processors that this process is pinned to: the median of turns.

    Not of wall time: another process that takes the processor during a turn does not change its speed.
    """
    points = _points()
    times = []
    for _ in range(REPEATS):
        begin = time.thread_time()
        _work(points)
        times.append(time.thread_time() - begin)
    return float(np.median(times))
