"""Inside and outside of a mesh, also of one with holes."""

from __future__ import annotations

import numpy as np


def inside(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether points are inside a mesh: where its generalised winding number exceeds one half in absolute value.

    Jacobson et al. 2013, by the approximation of Barill et al. 2018 in libigl, with an error below 0.01 that matters
    only within a small part of a triangle's size of the surface. Orientation does not matter as long as it is
    consistent.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (f, 3) int array, f >= 1
    points : (n, 3) array

    Returns
    -------
    (n,) bool array
    """
    import igl

    from .neighbours import OrderedPoints

    queries = OrderedPoints(np.asarray(points, dtype=np.float64))
    number = igl.fast_winding_number(
        np.ascontiguousarray(vertices, dtype=np.float64),
        np.ascontiguousarray(faces, dtype=np.int64),
        queries.along_curve,
    )
    return queries.restore(np.abs(number) > 0.5)
