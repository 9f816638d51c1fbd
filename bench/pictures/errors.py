"""The error of an output at each of its vertices or points: how far it is from the reference."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ..geometry.cloud import PointCloud

if TYPE_CHECKING:
    from trimesh import Trimesh

QUANTILE = 0.98  # of all distances that are shown: beyond it the colour is that of the limit


def distances(shape: Trimesh | PointCloud, reference: Trimesh | PointCloud) -> np.ndarray:
    """Distance of each vertex or point to the reference, in the unit of both (radii, in the frame of a case).

    Parameters
    ----------
    shape : Trimesh or PointCloud
        With n vertices or points.
    reference : Trimesh or PointCloud
        Distances to a mesh are exact; those to a cloud, or a mesh without faces, are to its nearest point.

    Returns
    -------
    (n,) float64 array
    """
    from ..geometry.cloud_surface import CloudSurface
    from ..geometry.mesh_surface import MeshSurface

    points = np.asarray(positions(shape), dtype=np.float64)
    if not len(points):
        return np.zeros(0)
    surface: CloudSurface | MeshSurface
    if isinstance(reference, PointCloud) or not len(reference.faces):
        surface = CloudSurface(PointCloud(positions(reference)))
    else:
        surface = MeshSurface(reference)
    return np.linalg.norm(points - surface.closest(points)[0], axis=1)


def positions(shape: Trimesh | PointCloud) -> np.ndarray:
    """The (n, 3) vertices of a mesh or points of a cloud."""
    return shape.points if isinstance(shape, PointCloud) else shape.vertices


def weights(shape: Trimesh | PointCloud) -> np.ndarray:
    """The share of a shape that each vertex or point represents, (n,), summing to 1: a third of the area of its faces.

    Points of a cloud count the same, and so do the vertices of a mesh without area.
    """
    n = len(positions(shape))
    if not isinstance(shape, PointCloud) and len(shape.faces):
        a, b, c = (np.asarray(shape.vertices)[shape.faces[:, i]] for i in range(3))
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        found = np.bincount(shape.faces.ravel(), np.repeat(area, 3), minlength=n)
        if found.sum() > 0:
            return found / found.sum()
    return np.full(n, 1 / max(n, 1))


def common_limit(shown: Iterable[tuple[np.ndarray, np.ndarray]], quantile: float = QUANTILE) -> float:
    """The distance at the end of a colour scale that several shapes share, rounded up to two digits.

    Parameters
    ----------
    shown : iterable of (distances, weights)
        Of each shape, from :func:`distances` and :func:`weights`; each shape counts the same, whatever its number of
        vertices.
    quantile : float
        The share of all distances below the limit.

    Returns
    -------
    float
        0 if no distance is above 0.
    """
    pairs = [(d, w) for d, w in shown if len(d)]
    if not pairs:
        return 0.0
    values, mass = (np.concatenate(arrays) for arrays in zip(*pairs, strict=True))
    order = np.argsort(values)
    below = np.cumsum(mass[order]) / mass.sum()
    limit = float(values[order][min(int(np.searchsorted(below, quantile)), len(values) - 1)])
    return rounded_up(limit) if limit > 0 else float(rounded_up(values.max()))


def rounded_up(value: float) -> float:
    """The next number with two digits that is not below: 0.01234 -> 0.013."""
    if not value > 0:
        return 0.0
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.ceil(value / unit - 1e-9) * unit:.6g}")
