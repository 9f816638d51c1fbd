"""Attributes of the points of a cloud besides normals, carried over to the output of a method."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..notices import notice
from .cloud import PointCloud

if TYPE_CHECKING:
    from trimesh import Trimesh

IN_ORDER = 0.1  # rows match where points moved by less than this share of the distance between rows taken at random


def carried(source: PointCloud, output: PointCloud | Trimesh) -> PointCloud | Trimesh:
    """An output with the colours and scalars of the cloud that it was made from, if it has none of its own.

    An output point at the place of an input point takes its attributes. Where the places differ and there are
    as many points in the same order (as after most denoising), row by row; otherwise each takes those of the nearest
    input point. A notice says which. A mesh takes colours if all its vertices are input points.

    Parameters
    ----------
    source, output : in the same coordinates, finite
    """
    if not isinstance(output, PointCloud):
        return _colored(source, output)
    scalars = {name: values for name, values in source.scalars.items() if name not in output.scalars}
    colors = source.colors if output.colors is None else None
    if colors is None and not scalars or not len(source):
        return output
    rows, how = _matched(source.points, output.points)
    if how:
        what = [*(["colours"] if colors is not None else []), *scalars]
        notice(f"{', '.join(what)} of the output: {how}")
    arrays = {} if colors is None else {"colors": colors[rows]}
    added = PointCloud(output.points, None, arrays.get("colors"), {name: v[rows] for name, v in scalars.items()})
    return PointCloud.of(added.arrays() | output.arrays())


def _colored(source: PointCloud, mesh: Trimesh) -> Trimesh:
    """The mesh with the colours of the points at its vertices."""
    visual: Any = mesh.visual  # of colours, or of a texture
    if source.colors is None or visual.kind is not None:
        return mesh
    rows, found = same_places(source.points, np.asarray(mesh.vertices))
    if not found.all():
        return mesh
    mesh = mesh.copy()
    visual = mesh.visual
    visual.vertex_colors = np.rint(255 * source.colors[rows]).astype(np.uint8)
    return mesh


def _matched(points: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, str]:
    """The row of ``points`` for each of ``others``, and how it was found, in words; none if the places are equal."""
    rows, found = same_places(points, others)
    if found.all():
        return rows, ""
    if len(points) == len(others):
        apart = np.random.default_rng(0).permutation(len(points))
        moved, typical = (np.linalg.norm(others - points[k], axis=1) for k in (slice(None), apart))
        if np.median(moved) < IN_ORDER * np.median(typical):
            return np.arange(len(points)), "those of the input, row by row"
    from scipy.spatial import cKDTree

    rows[~found] = cKDTree(points).query(others[~found])[1]
    return rows, "those of the nearest input point"


def same_places(points: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each of ``others`` (m, 3) the row in ``points`` (n, 3) that has exactly its coordinates.

    Returns
    -------
    rows : (m,) int array
        The first of several is for the first of ``others`` at that place, the second for the second, and so on.
    found : (m,) bool array
        Whether there is one.
    """
    both = np.concatenate([points, others]) + 0.0  # -0.0 and 0.0 are one place
    order = np.lexsort(both.T)  # stable: of each place the points come first
    begins = np.concatenate([[True], (both[order[1:]] != both[order[:-1]]).any(axis=1)])
    place = np.cumsum(begins) - 1
    first = np.flatnonzero(begins)
    there = np.bincount(place, order < len(points)).astype(np.int64)
    nth = np.arange(len(both)) - first[place] - there[place]  # among the others at this place
    rows, found = np.zeros(len(both), dtype=np.int64), np.zeros(len(both), dtype=bool)
    rows[order] = order[first[place] + np.clip(nth, 0, np.maximum(there[place] - 1, 0))]
    found[order] = there[place] > 0
    return rows[len(points) :], found[len(points) :]
