"""Where the methods of a figure differ most: the place that an inset shows larger."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..errors import UsageError
from .camera import Camera, Window

RADIUS = 0.16  # of the place that an inset shows, in radii of the reference
CANDIDATES = 600
DEPTH = 0.06  # radii: a place with something this far in front of it is hidden
FACING = 0.6  # the least cosine between a normal and the view: surfaces seen from the side show little


class Zoom(NamedTuple):
    """A ball of which an inset shows the inside; in radii of the reference, in the frame of the case."""

    center: tuple[float, float, float]
    radius: float

    def window(self, camera: Camera) -> Window:
        """The square around the ball."""
        middle = camera.project(np.array([self.center]))[0]
        return Window((float(middle[0]), float(middle[1])), (self.radius, self.radius))


def zoom_of(text: str) -> Zoom:
    """From a text of the command line, ``X,Y,Z,R``.

    Raises
    ------
    UsageError
        For anything else.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 4 or not np.isfinite(values).all() or not values[3] > 0:
        raise UsageError(
            f"--zoom {text}: expected X,Y,Z,R: a point in the frame of the case (box centre of the reference at 0, "
            "farthest vertex at 1) and a radius above 0, like 0.2,-0.5,0.3,0.15"
        )
    x, y, z, radius = values
    return Zoom((x, y, z), radius)


def where_they_differ(
    reference: tuple[np.ndarray, np.ndarray],
    outputs: Sequence[tuple[np.ndarray, np.ndarray]],
    camera: Camera,
    limit: float,
    radius: float = RADIUS,
) -> Zoom | None:
    """The visible place of the reference at which the errors of the methods differ most.

    Parameters
    ----------
    reference : points, normals
        Two (n, 3) arrays: samples of the reference, in a fixed order.
    outputs : sequence of (points, errors)
        Of each method its vertices or points (n, 3), and their distances to the reference (n,).
    camera : Camera
    limit : float
        Errors beyond count as much: the colours do not show them. A method without points at a place has this error.
    radius : float
        Of the place.

    Returns
    -------
    Zoom or None
        None with fewer than two methods, or if nothing is visible.
    """
    from scipy.spatial import cKDTree

    points, normals = reference
    rows = visible(points, normals, camera)
    if len(outputs) < 2 or not len(rows) or not limit > 0:
        return None
    rows = rows[:: max(1, len(rows) // CANDIDATES)]
    means = np.full((len(outputs), len(rows)), limit)
    for mean, (where, errors) in zip(means, outputs, strict=True):
        step = max(1, len(where) // 40_000)
        capped = np.minimum(errors[::step], limit)
        near = cKDTree(where[::step]).query_ball_point(points[rows], radius)
        mean[:] = [capped[ids].mean() if ids else limit for ids in near]
    best = int(np.argmax(means.std(axis=0)))
    x, y, z = (float(value) for value in points[rows[best]])
    return Zoom((x, y, z), radius)


def visible(points: np.ndarray, normals: np.ndarray, camera: Camera) -> np.ndarray:
    """Which samples of a surface face the camera with nothing in front of them, (k,) indices."""
    from scipy.spatial import cKDTree

    seen = camera.project(points)
    facing = np.flatnonzero(np.asarray(normals) @ camera.axes[2] > FACING)
    reach = 3 * np.sqrt(4.0 / max(len(points), 1))  # about three distances of samples of a surface of a few radii^2
    hidden = [
        seen[ids, 2].max() > seen[row, 2] + DEPTH
        for row, ids in zip(facing, cKDTree(seen[:, :2]).query_ball_point(seen[facing, :2], reach / 3), strict=True)
    ]
    return facing[~np.array(hidden, dtype=bool)]
