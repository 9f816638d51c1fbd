"""A cloud upsampled patch by patch."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench.geometry.farthest import farthest_points

from .cut import Cutting, Normalised, centrality, covering, cut, most_central, normalise


def in_patches(
    points: np.ndarray,
    size: int,
    overlap: float,
    upsample_patches: Callable[[np.ndarray], np.ndarray],
    count: int,
    central: int = 0,
    used: int | None = None,
    cutting: Cutting = cut,
) -> np.ndarray:
    """Upsample overlapping patches of a cloud, and thin the merged points to ``count``.

    Parameters
    ----------
    points : (m, 3) array
    size : int
        Points of a patch; all of them if the cloud has fewer.
    overlap : float
        The number of patches that a point is in, on average.
    upsample_patches : function
        Given (h, n, 3) float64 normalised patches, the seed first, it returns (h, r u, 3) points in the same frames:
        first copies of the first u points of each patch, then second ones, and so on.
    count : int
        At most r m.
    central : int
        The number of patches, of those in which a point is nearest the seed, whose copies of it count; 0 for all.
    used : int, optional
        u, if it is less than n.
    cutting : function
        Cuts the patches.

    Returns
    -------
    (count, 3) float64 array
        Farthest points if there are more. The order of the input makes no difference.
    """
    points, frame = whole(points)
    patches = covering(points, size, overlap, used, cutting)
    normalised = normalise(points[patches])
    dense = normalised.restore(upsample_patches(normalised.points))
    dense = most_central(dense, centrality(patches[:, :used]), central)
    return frame.restore((dense if len(dense) == count else dense[farthest_points(dense, count)])[None])[0]


def whole(points: np.ndarray) -> tuple[np.ndarray, Normalised]:
    """A cloud (m, 3) in sorted order, centroid at 0 and farthest point at 1; and the frame to restore it."""
    # The order of the points affects sums by rounding, and decides ties.
    points = np.asarray(points, dtype=np.float64)
    frame = normalise(points[np.lexsort(points.T)][None])
    return frame.points[0], frame
