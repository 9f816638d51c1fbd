"""Oriented points to begin with, where there are images alone: on the visual hull."""

from __future__ import annotations

import numpy as np

from bench import BadInput, PointCloud, Run, Views
from bench.geometry.farthest import farthest_points
from bench.geometry.normals import estimate_normals

from .hull import hull_depths

CELLS = 64  # of the hull, along each axis
CROWD = 6  # so many candidates for each point
NEIGHBOURS = 24  # candidates through which the plane of each is laid


def points_on_the_hull(views: Views, count: int, run: Run) -> PointCloud:
    """At most so many points on the visual hull, evenly, with normals.

    The depths at which the pixels' rays enter the hull give a point each. Of some of them, drawn at random, the normals
    are those of planes through their neighbours, turned to the cameras that see them; farthest points are kept.

    Parameters
    ----------
    views : Views
    count : int
    run : Run
        Draws the candidates.

    Raises
    ------
    BadInput
        If the masks have nothing in common.
    """
    depths = hull_depths(views, CELLS)
    view, row, column = np.nonzero(np.isfinite(depths))
    if len(view) < 3:
        raise BadInput(
            "the masks disagree: nothing lies within all silhouettes; expected masks and cameras of one shape"
        )
    drawn = np.sort(run.rng.permutation(len(view))[: CROWD * count])
    view, row, column = view[drawn], row[drawn], column[drawn]
    points = np.empty((len(view), 3))
    for number in range(len(views)):
        here = view == number
        pixels = np.stack([column[here], row[here]], axis=1) + 0.5
        points[here] = views.unproject(number, pixels, depths[number, row[here], column[here]])
    estimate = estimate_normals(points, min(NEIGHBOURS, len(points)))
    points, normals = estimate.flattened, estimate.normals
    away = np.einsum("ni,ni->n", normals, views.centers[view] - points) < 0
    normals = np.where(away[:, None], -normals, normals)
    kept = farthest_points(points, min(count, len(points)))
    return PointCloud(points[kept], normals[kept])
