"""What a geometry file holds, before anybody asks whether it is a mesh or a cloud."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np

from ...errors import BadInput


class RawGeometry(NamedTuple):
    """Arrays as a file gives them: (v, 3) float64, (f, 3) int64, and (v, 3) normals and colours in 0..1 if stored."""

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None = None
    colors: np.ndarray | None = None


NO_FACES = np.empty((0, 3), dtype=np.int64)


def triangulate(sizes: np.ndarray, corners: np.ndarray, vertices: int, name: str) -> np.ndarray:
    """Polygons as fans of triangles around their first corner, in the order of the file.

    Parameters
    ----------
    sizes : (p,) int array, corners of each polygon
    corners : (sum of sizes,) int array, vertex indices
    vertices : int, how many there are
    name : str, of the file, for messages

    Returns
    -------
    faces : (f, 3) int64 array

    Raises
    ------
    BadInput
        If an index names no vertex. Polygons of fewer than three corners are left out, with a warning.
    """
    bad = np.flatnonzero((corners < 0) | (corners >= vertices))
    if len(bad):
        raise BadInput(
            f"{name}: {len(bad)} face corners name vertices that do not exist (the first is {corners[bad[0]]}, of "
            f"{vertices} vertices counted from 0); the file is damaged, export it again"
        )
    if (sizes < 3).any():
        warnings.warn(f"{name}: {int((sizes < 3).sum())} faces of fewer than 3 corners are left out", stacklevel=2)
    starts = np.cumsum(sizes) - sizes
    triangles = np.maximum(sizes - 2, 0)
    first = np.repeat(starts, triangles)
    step = np.arange(len(first)) - np.repeat(np.cumsum(triangles) - triangles, triangles) + 1
    return corners[np.stack([first, first + step, first + step + 1], axis=1)].astype(np.int64).reshape(-1, 3)
