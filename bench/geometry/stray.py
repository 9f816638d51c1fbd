"""Points of a cloud that lie far from all others, and the frame of a cloud, whatever they do."""

from __future__ import annotations

import numpy as np

from .cloud import Frame

FEWEST = 100  # points; among fewer, none counts as a stray
SHARE = 0.005  # of the points at each end of each axis that the box of the bulk leaves out
MOST = 0.01  # share of the points that may be strays; more are a part of the scene
SMALLER = 5.0  # how many times larger strays make the box of a cloud, at least
FAR = 20.0  # and how many times, for the frame to be that of the others: the bulk would be a dot in the frame of all


def strays(points: np.ndarray) -> np.ndarray | None:
    """Which of the points (n, 3) lie far from all others, as a mask (n,); None where there are none.

    The box of the bulk leaves out the outermost points of each axis. A stray is farther from that box than its longest
    side, and strays are few but make the box of all points :data:`SMALLER` times larger.
    """
    if len(points) < FEWEST:
        return None
    low, high = bulk(points)
    size, inner = np.ptp(points, axis=0).max(), (high - low).max()
    if not size > SMALLER * inner > 0:
        return None
    far = ((points < low - inner) | (points > high + inner)).any(axis=1)
    is_few = 0 < far.mean() <= MOST
    return far if is_few and size > SMALLER * np.ptp(points[~far], axis=0).max() else None


def bulk(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The box of the points (n, 3) without the outermost of each axis: two corners (3,)."""
    last = len(points) - 1
    cut = min(max(1, int(SHARE * len(points))), last // 2)
    ordered = np.partition(points, [cut, last - cut], axis=0)
    return ordered[cut], ordered[last - cut]


def frame_of_bulk(points: np.ndarray) -> Frame:
    """The frame in which points (n, 3), or all but a few that are very far from them, have radius 1.

    The reader of a file gives a notice of such points (:mod:`bench.geometry.suspicions`).
    """
    far = strays(points)
    if far is None or np.ptp(points, axis=0).max() <= FAR * np.ptp(points[~far], axis=0).max():
        return Frame.of(points)
    return Frame.of(points[~far])
