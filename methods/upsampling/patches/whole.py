"""A cloud upsampled patch by patch."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench.geometry.farthest import farthest_points

from .cut import Normalised, cut, normalise, seed_count


def in_patches(
    points: np.ndarray,
    size: int,
    overlap: float,
    upsample_patches: Callable[[np.ndarray], np.ndarray],
    count: int,
) -> np.ndarray:
    """Upsample overlapping patches of a cloud, and thin what they give together to ``count`` points.

    Parameters
    ----------
    points : (m, 3) array
    size : int
        Points of a patch; all of them where the cloud has fewer.
    overlap : float
        How many patches a point is in, on average.
    upsample_patches : function
        Given (h, n, 3) float64 normalised patches, it returns (h, r n, 3) points in the same frames.
    count : int
        At most h r n: what the patches give together.

    Returns
    -------
    (count, 3) float64 array
        In greedy order, from the farthest points on. The order of the input makes no difference.
    """
    points, frame = whole(points)
    patches = patches_of(points, size, overlap)
    normalised = normalise(points[patches])
    dense = normalised.restore(upsample_patches(normalised.points)).reshape(-1, 3)
    return frame.restore(dense[farthest_points(dense, count)][None])[0]


def whole(points: np.ndarray) -> tuple[np.ndarray, Normalised]:
    """A cloud (m, 3) in sorted order, centroid at 0 and farthest point at 1; and the frame to restore it."""
    # Sums depend on the order of the points by rounding, and ties are decided by it.
    points = np.asarray(points, dtype=np.float64)
    frame = normalise(points[np.lexsort(points.T)][None])
    return frame.points[0], frame


def patches_of(points: np.ndarray, size: int, overlap: float) -> np.ndarray:
    """Patches around farthest points: (h, min(size, m)) indices into points (m, 3)."""
    size = min(size, len(points))
    seeds = farthest_points(points, min(seed_count(len(points), size, overlap), len(points)))
    return cut(points, seeds, size)
