"""Arrays to CGAL point sets and back. The bindings know no arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from CGAL.CGAL_Point_set_3 import Point_set_3


def to_point_set(points: np.ndarray) -> Point_set_3:
    """A new point set of ``points`` (n, 3). New for every call: CGAL's algorithms reorder theirs in place."""
    from CGAL.CGAL_Kernel import Point_3
    from CGAL.CGAL_Point_set_3 import Point_set_3

    point_set = Point_set_3()
    point_set.reserve(len(points))
    for point in points.tolist():
        point_set.insert(Point_3(*point))
    return point_set


def to_array(point_set: Point_set_3) -> np.ndarray:
    """The points of a set, an (n, 3) float64 array."""
    return np.array([(p.x(), p.y(), p.z()) for p in point_set.points()], dtype=np.float64).reshape(-1, 3)
