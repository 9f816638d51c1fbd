"""Views of the parts where the images differ most (thesis 3.2.1, figure 3.22)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .views import Gallery, Window

POOL = 9  # pixels across the squares over which the error is averaged
NEAREST = 5  # points whose mean is the focus
TRIED = 50  # pixels of a view with the largest errors, as candidates away from previous places


class Focus(NamedTuple):
    """A place in the world, and parts of some images around it."""

    place: np.ndarray
    gallery: Gallery
    views: np.ndarray
    """The images of which they are parts"""


def focus(
    gallery: Gallery,
    points: np.ndarray,
    normals: np.ndarray,
    sigma: float,
    part: float,
    count: int,
    before: list[np.ndarray],
    apart: float,
) -> Focus | None:
    """The place where the images differ most from those of the points, and the parts of images around it.

    It is found from the pixel with the largest error in all views, averaged over 9 x 9 pixels; the place is the mean of
    the five points that are drawn nearest to it. The thesis moves the cameras near to it. Given images cannot
    be taken again, so parts of those that differ most there are used: the loss is the mean over their
    pixels, so each of them has more weight.

    Parameters
    ----------
    gallery : Gallery
    points, normals : (n, 3) arrays
    sigma : float
        Of the points.
    part : float
        Width and height of the parts, relative to the images.
    count : int
        The number of images.
    before : list of (3,) arrays
        Previous places; no place nearer than ``apart`` to them is chosen.
    apart : float

    Returns
    -------
    Focus, or None if no place is left
    """
    errors = []
    best, place = 0.0, None
    for view in range(len(gallery.cameras)):
        drawn = gallery.draw(points, normals, sigma, view)
        errors.append(_pooled(np.abs(drawn.image - gallery.wanted[view]).sum(axis=2)))
        shown = np.flatnonzero(drawn.ellipses.shown)
        if not len(shown):
            continue
        for row, column in _largest(errors[-1]):
            if errors[-1][row, column] <= best:
                break
            off = np.linalg.norm(drawn.ellipses.place[shown] - [column + 0.5, row + 0.5], axis=1)
            found = points[shown[np.argsort(off, kind="stable")[:NEAREST]]].mean(axis=0)
            if all(np.linalg.norm(found - other) >= apart for other in before):
                best, place = float(errors[-1][row, column]), found
                break
    if place is None:
        return None
    windows = [_around(gallery, view, place, part) for view in range(len(gallery.cameras))]
    there = [errors[w.view][w.top : w.top + w.height, w.left : w.left + w.width].mean() for w in windows]
    worst = np.argsort(there, kind="stable")[::-1][:count]
    return Focus(place, gallery.cropped([windows[k] for k in worst]), worst)


def _pooled(error: np.ndarray) -> np.ndarray:
    from scipy.ndimage import uniform_filter

    return uniform_filter(error, POOL)


def _largest(error: np.ndarray) -> np.ndarray:
    """Rows and columns (k, 2) of pixels with the largest errors, one in each averaging square."""
    coarse = error[POOL // 2 :: POOL, POOL // 2 :: POOL]
    order = np.argsort(-coarse, axis=None, kind="stable")[:TRIED]
    return np.column_stack(np.unravel_index(order, coarse.shape)) * POOL + POOL // 2


def _around(gallery: Gallery, view: int, place: np.ndarray, part: float) -> Window:
    """The part of an image around a place, moved so that it lies within the image."""
    camera = gallery.cameras[view]
    width, height = max(1, round(part * camera.width)), max(1, round(part * camera.height))
    fx, fy, skew, cx, cy = camera.lens()
    x, y, z = camera.to_camera(place[None])[0]
    z = max(z, 1e-9)
    left, top = round((fx * x + skew * y) / z + cx - width / 2), round(fy * y / z + cy - height / 2)
    left = min(max(left, 0), camera.width - width)
    top = min(max(top, 0), camera.height - height)
    return Window(view, left, top, width, height)
