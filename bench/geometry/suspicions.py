"""Suspicious coordinates in a file: saved too coarsely, or spread by strays."""

from __future__ import annotations

import numpy as np

from ..notices import notice
from .stray import bulk, strays

FEWEST = 100  # points; of fewer, nothing is reported
COARSE = 0.05  # steps of the coordinates, in typical spacings of the points, above which they are visible


def notice_suspicions(points: np.ndarray, name: str) -> None:
    """Give a notice where the coordinates (n, 3), finite, have coarse steps, or a few points make the box large.

    ``name`` is that of the file.
    """
    if steps := single_steps(points):
        sizes = " to ".join(dict.fromkeys(f"{step:.1g}" for step in (min(steps), max(steps))))
        notice(
            f"{name}: its coordinates have steps of {sizes}: they were saved in single precision, far from the "
            "origin; export it in double precision, or moved to the origin"
        )
    far = strays(points)
    if far is not None:
        whole, rest = np.ptp(points, axis=0), np.ptp(points[~far], axis=0)
        share = np.prod(rest[whole > 0] / whole[whole > 0])
        notice(
            f"{name}: {(~far).sum():,} of {len(points):,} points lie in {100 * share:.2g} % of its box, the rest far "
            "from them; remove outliers first (method=radius_outlier)"
        )


def single_steps(points: np.ndarray) -> list[float]:
    """The steps of the axes whose coordinates are multiples of those of float32, where these are visible."""
    if len(points) < FEWEST:
        return []
    low, high = bulk(points)
    spacing = (high - low).max() / np.sqrt(len(points))
    steps = []
    for axis in points.T:
        farthest = np.abs(axis).max()
        step = float(np.spacing(np.float32(farthest))) if farthest < 1e30 else 0.0
        if step <= COARSE * spacing or not np.ptp(axis):
            continue
        multiples = axis / step
        # Coordinates of a coarser grid of their own are even multiples; they have lost nothing.
        top = np.abs(axis) >= farthest / 2
        if (axis == axis.astype(np.float32)).all() and (multiples[top] % 2 == 1).any():
            steps.append(step)
    return steps
