"""Conversion of arrays to CGAL's point sets and polyhedra, and back. The bindings do not support arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from CGAL.CGAL_Point_set_3 import Point_set_3
    from CGAL.CGAL_Polyhedron_3 import Polyhedron_3


def to_point_set(points: np.ndarray, normals: np.ndarray | None = None) -> Point_set_3:
    """A new point set of ``points`` (n, 3), with ``normals`` (n, 3) if given.

    New for every call: CGAL's algorithms reorder theirs in place.
    """
    from CGAL.CGAL_Kernel import Point_3, Vector_3
    from CGAL.CGAL_Point_set_3 import Point_set_3

    point_set = Point_set_3()
    point_set.reserve(len(points))
    if normals is None:
        for point in points.tolist():
            point_set.insert(Point_3(*point))
        return point_set
    point_set.add_normal_map()
    for point, normal in zip(points.tolist(), normals.tolist(), strict=True):
        point_set.insert(Point_3(*point), Vector_3(*normal))
    return point_set


def to_array(point_set: Point_set_3) -> np.ndarray:
    """The points of a set, an (n, 3) float64 array."""
    return np.array([(p.x(), p.y(), p.z()) for p in point_set.points()], dtype=np.float64).reshape(-1, 3)


def to_normals(point_set: Point_set_3) -> np.ndarray:
    """The normals of a set, an (n, 3) float64 array."""
    return np.array([(v.x(), v.y(), v.z()) for v in point_set.normals()], dtype=np.float64).reshape(-1, 3)


def to_mesh(polyhedron: Polyhedron_3) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) and triangles (f, 3) of a polyhedron whose facets are triangles."""
    vertices = []
    for index, vertex in enumerate(polyhedron.vertices()):
        vertex.set_id(index)
        point = vertex.point()
        vertices.append((point.x(), point.y(), point.z()))
    faces = []
    for facet in polyhedron.facets():
        edge = facet.halfedge()
        faces.append((edge.vertex().id(), edge.next().vertex().id(), edge.next().next().vertex().id()))
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), np.array(faces, dtype=np.int64).reshape(-1, 3)
