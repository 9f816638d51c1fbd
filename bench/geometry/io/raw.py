"""The contents of a geometry file, before they become a mesh or a cloud."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class RawGeometry(NamedTuple):
    """Arrays as a file gives them: (v, 3) float64, (f, 3) int64, and (v, 3) normals and colours in 0..1 if stored.

    ``scalars`` are further numbers of each vertex by name, (v,) float64: intensity, time, class, ...
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None = None
    colors: np.ndarray | None = None
    scalars: dict[str, np.ndarray] | None = None


NO_FACES = np.empty((0, 3), dtype=np.int64)
