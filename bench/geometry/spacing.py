"""How densely a point cloud is sampled."""

from __future__ import annotations

import numpy as np

from ..errors import BadInput
from .distinct import distinct_rows
from .neighbours import processors


def mean_spacing(points: np.ndarray) -> float:
    """The mean distance of a point to its nearest neighbour: the natural unit for radii.

    Points that coincide count once, and the farthest hundredth of the distances is left out, so that a few outliers do
    not move it. For points at random on a surface (a Poisson process of density d per area) it is about 0.5 / sqrt(d);
    for a regular grid, the grid's step.

    Parameters
    ----------
    points : (n, 3) array, finite

    Returns
    -------
    float
        In the unit of the points, > 0.

    Raises
    ------
    BadInput
        If fewer than two points differ.
    """
    from scipy.spatial import cKDTree

    distinct, _ = distinct_rows(points)
    if len(distinct) < 2:
        raise BadInput(f"{len(points)} points, of which {len(distinct)} differ: a spacing needs at least 2")
    distances = np.sort(cKDTree(distinct).query(distinct, 2, workers=processors())[0][:, 1])
    kept = max(1, int(np.ceil(0.99 * len(distances))))
    return float(distances[:kept].mean())
