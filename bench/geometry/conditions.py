"""The realised state of a cloud: noise, outliers, holes and unevenness against the truth.

A sensor's parameters are nominal: two sensors set to "1 %" need not be equally hard. These
figures are measured on the cloud itself, so that levels compare across sensors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..contract.case import Case
    from .cloud import PointCloud

OUTLIER = 0.05  # a point farther than this from the surface, as a share of the bounding-sphere radius
SAMPLES = 10_000  # of the reference, for the coverage
NEIGHBOURS = 8  # behind a local density


def describe_cloud(cloud: PointCloud, case: Case) -> dict[str, float]:
    """The realised state of an input cloud.

    Parameters
    ----------
    cloud : PointCloud of N points, in the frame of the case
    case : Case
        Its reference, of area A, is the truth.

    Returns
    -------
    dict
        ``points`` N; ``rms`` and ``rms_inliers``: root mean square distance to the reference mesh of all points, and
        of those that are not outliers; ``outliers``: share of the points that are farther than 0.05 from it;
        ``coverage``: share of the surface within ``2 sqrt(A / N)`` of a point (independent uniform points leave out
        exp(-4 pi), four in a million); ``density_variation``: standard deviation over mean of the area that eight
        neighbours take up, over points that are no outliers (independent uniform points: 1 / sqrt(8) = 0.35; evenly
        spread ones about 0.1), left out for fewer than ten such points. The last two are left out for curves.
    """
    from scipy.spatial import cKDTree

    from .comparison import Comparison

    pair = Comparison(cloud, case, SAMPLES)
    distance = pair.to_surface.distance
    near = distance <= OUTLIER
    reach = 2 * np.sqrt(case.reference.mesh.area / len(cloud))
    figures = {
        "points": len(cloud),
        "rms": np.sqrt((distance**2).mean()),
        "rms_inliers": np.sqrt((distance[near] ** 2).mean()) if near.any() else np.nan,
        "outliers": 1 - near.mean(),
        "coverage": (pair.to_output.distance <= reach).mean(),
    }
    if hasattr(case.reference.surface, "sample_evenly"):  # a curve: the area of its mesh is meaningless
        del figures["coverage"]
        return {name: float(value) for name, value in figures.items()}
    points = np.unique(cloud.points[near], axis=0)
    if len(points) > NEIGHBOURS + 1:
        area = cKDTree(points).query(points, [NEIGHBOURS + 1])[0][:, 0] ** 2
        figures["density_variation"] = area.std() / area.mean()
    return {name: float(value) for name, value in figures.items()}
