"""Checks of the input of every classical method, before native code uses it."""

from __future__ import annotations

import numpy as np

from bench import BadInput, PointCloud, Run
from bench.geometry.check import check_points
from bench.geometry.distinct import distinct_rows

FLAT = 0.02  # the ratio of thickness to width (standard deviations) below which points enclose nothing
COARSE = 5.0  # mean spacings; a wider cell loses detail of the points
ROUNDING = 0.01  # mean spacings: points that are less far off a plane are triangulated in the plane


def distinct_points(points: np.ndarray, method: str, at_least: int) -> tuple[np.ndarray, np.ndarray]:
    """The points without duplicates; libraries hang, crash or return NaN on input that is refused here.

    Parameters
    ----------
    points : (n, 3) array
    method : str
        Named in the messages.
    at_least : int
        How many points must differ.

    Returns
    -------
    distinct : (m, 3) float64 array, writeable (libraries refuse the cloud's frozen arrays)
    inverse : (n,) int array, so that ``distinct[inverse]`` are the points

    Raises
    ------
    BadInput
        If points are not finite, too few differ, or all lie on one line.
    """
    check_points(points, method, at_least=at_least)
    distinct, inverse = distinct_rows(points)
    if len(distinct) < at_least:
        raise BadInput(f"{method}: only {len(distinct)} of {len(points)} points differ; expected at least {at_least}")
    # Several of the libraries compute in float32, in which such points coincide: they crash.
    if not np.ptp(distinct, axis=0).max() > 1e-5 * np.abs(distinct).max():
        raise BadInput(f"{method}: all {len(points)} points nearly coincide; expected points of a surface")
    widths = np.linalg.svd(distinct - distinct.mean(axis=0), compute_uv=False)
    if not widths[1] > 1e-6 * widths[0]:
        raise BadInput(f"{method}: all {len(points)} points lie on one line; expected points of a surface")
    return distinct, inverse


def distinct_oriented(cloud: PointCloud, method: str, at_least: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """:func:`distinct_points` with unit normals, given or estimated.

    Returns
    -------
    distinct, normals : (m, 3) float64 arrays, writeable
    inverse : (n,) int array
    """
    from bench.geometry.normals import with_normals

    distinct, inverse = distinct_points(cloud.points, method, at_least)
    first = np.full(len(distinct), len(inverse))
    np.minimum.at(first, inverse, np.arange(len(inverse)))
    normals = with_normals(cloud).normals
    assert normals is not None
    return distinct, np.array(normals[first]), inverse


def plane_axes(points: np.ndarray) -> tuple[np.ndarray, float]:
    """The principal axes of points (n, 3), rows of a rotation, widest first; and the ratio of thickness to width."""
    _, widths, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    axes[2] *= np.sign(np.linalg.det(axes))
    return axes, float(widths[2] / widths[1])


def in_plane(points: np.ndarray, tolerance: float) -> np.ndarray | None:
    """Points (n, 3) as an (n, 2) array within their common plane, up to ``tolerance``; None if there is none.

    If rounding lifts points off a plane, triangulations in space find only wrong, thin tetrahedra.
    """
    center = points.mean(axis=0)
    local = (points - center) @ plane_axes(points)[0].T
    return local[:, :2] if np.abs(local[:, 2]).max() <= tolerance else None


def note_flat(points: np.ndarray, method: str, run: Run, what: str) -> None:
    """Note that points (n, 3) lie in a plane, and the effect on the surface."""
    if plane_axes(points)[1] < FLAT:
        run.note(f"{method}: the points lie in a plane, which has no volume: {what}")


def note_coarse(points: np.ndarray, cells: float, method: str, parameter: str, run: Run) -> None:
    """Note that a grid of ``cells`` along the longest side of the points (n, 3) cannot resolve them."""
    from bench.geometry.spacing import mean_spacing

    spacings = float(np.ptp(points, axis=0).max() / cells / mean_spacing(points))
    if spacings > COARSE:
        run.note(
            f"{method}: a cell of the grid is {spacings:.2g} mean spacings of the points wide, and finer detail is "
            f"lost; raise {parameter}, or process distant parts one by one"
        )
