"""What is wrong with the coordinates of a file although they are numbers: saved too coarsely, or spread by strays."""

from __future__ import annotations

import numpy as np

from ..notices import notice

FEWEST = 100  # points of which anything is said
COARSE = 0.05  # steps of the coordinates, in typical spacings of the points, above which they are visible
TRIMMED = 0.005  # share of the points that is left out at each end of each axis to find the box of the others
SMALLER, MOST_STRAYS = 5.0, 0.01  # how much smaller that box must be, and the share of points that may lie around it


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
    if found := far_points(points):
        count, share = found
        notice(
            f"{name}: {len(points) - count:,} of {len(points):,} points lie in {100 * share:.2g} % of its box, the "
            "rest far from them; remove outliers first (method=radius_outlier)"
        )


def single_steps(points: np.ndarray) -> list[float]:
    """The steps of the axes whose coordinates are multiples of those of float32, where these are visible."""
    if len(points) < FEWEST:
        return []
    low, high = _trimmed(points)
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


def far_points(points: np.ndarray) -> tuple[int, float] | None:
    """How many points lie far from the others, and the share of the volume of the box that is left to these.

    None where the box of most points is not much smaller than that of all.
    """
    if len(points) < FEWEST:
        return None
    low, high = _trimmed(points)
    whole, inner = np.ptp(points, axis=0), (high - low).max()
    if not whole.max() > SMALLER * inner:
        return None
    near = ((points >= low - inner) & (points <= high + inner)).all(axis=1)
    sizes = np.ptp(points[near], axis=0)
    if not 0 < 1 - near.mean() <= MOST_STRAYS or not whole.max() > SMALLER * sizes.max():
        return None
    return int((~near).sum()), float(np.prod(sizes[whole > 0] / whole[whole > 0]))


def _trimmed(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The box of the points without the outermost of each axis: two corners (3,)."""
    last = len(points) - 1
    cut = min(max(1, int(TRIMMED * len(points))), last // 2)
    ordered = np.partition(points, [cut, last - cut], axis=0)
    return ordered[cut], ordered[last - cut]
