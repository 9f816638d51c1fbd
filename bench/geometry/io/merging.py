"""Vertices at equal places as one."""

from __future__ import annotations

import numpy as np

from .raw import RawGeometry


def merge_equal(vertices: np.ndarray, faces: np.ndarray | None = None) -> RawGeometry:
    """A mesh in which vertices at exactly equal places are one, numbered by their first appearance.

    Parameters
    ----------
    vertices : (v, 3) array
        NaN equals nothing.
    faces : (f, 3) int array, optional
        Without it, three vertices after the other are a triangle.
    """
    points = vertices + 0.0  # -0.0 and 0.0 are one place
    order = np.lexsort(points.T)
    with np.errstate(invalid="ignore"):
        differs = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    group = np.empty(len(points), dtype=np.int64)
    group[order] = np.concatenate([[0], np.cumsum(differs)])[: len(points)]
    # lexsort is stable: the first of each group is its first appearance.
    first = order[np.concatenate([[True], differs])[: len(points)]]
    by_appearance = np.argsort(first)
    rank = np.empty(len(first), dtype=np.int64)
    rank[by_appearance] = np.arange(len(first))
    number = rank[group]
    return RawGeometry(points[first[by_appearance]], number.reshape(-1, 3) if faces is None else number[faces])
