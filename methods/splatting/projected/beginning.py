"""Initial oriented points if there are only images: on the visual hull."""

from __future__ import annotations

import numpy as np

from bench import BadInput, PointCloud, Run, Views
from bench.geometry.farthest import farthest_points
from bench.geometry.normals import estimate_normals

from .hull import hull_depths

CELLS = 64  # of the hull, along each axis
CROWD = 6  # candidates for each point
NEIGHBOURS = 24  # candidates for fitting the plane of each


def points_on_the_hull(views: Views, count: int, run: Run) -> PointCloud:
    """At most ``count`` points on the visual hull, evenly spread, with normals.

    The depth at which a pixel's ray enters the hull gives a point. The normals of a random part of them
    are those of planes through their neighbours, turned to the cameras that see them; farthest points are selected.

    Parameters
    ----------
    views : Views
    count : int
    run : Run
        Draws the candidates.

    Raises
    ------
    BadInput
        If no point lies within all silhouettes.
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
