"""The polygons of a file as triangles."""

from __future__ import annotations

import numpy as np

from ...errors import BadInput
from ...notices import notice

ROUNDING = 1e-6  # the share of an area by which triangles may overlap: what float32 rounds

TOLERANCES = (0, 1e-6, 1e-4, 1e-3)  # of the extent of a polygon, tried in turn; the first is that of rounding


def triangulate(sizes: np.ndarray, corners: np.ndarray, vertices: np.ndarray, name: str) -> np.ndarray:
    """Polygons as triangles, two fewer than corners each, in the order of the file.

    Polygons become fans around their first corner. A quadrangle whose fan folds over gets the other diagonal if that
    one does not, and larger polygons whose fans fold over are cut by ears (manifold3d) in the plane of their Newell
    normal, so that the area of a flat polygon does not depend on where it begins. One that crosses itself has no area
    to keep; whatever becomes of it, it is as many triangles.

    Parameters
    ----------
    sizes : (p,) int array, corners of each polygon
    corners : (sum of sizes,) int array, vertex indices
    vertices : (v, 3) array
    name : str, of the file, for messages

    Returns
    -------
    faces : (f, 3) int64 array

    Raises
    ------
    BadInput
        If an index names no vertex. Polygons of fewer than three corners are left out, with a notice.
    """
    bad = np.flatnonzero((corners < 0) | (corners >= len(vertices)))
    if len(bad):
        raise BadInput(
            f"{name}: {len(bad)} face corners name vertices that do not exist (the first is {corners[bad[0]]}, of "
            f"{len(vertices)} vertices counted from 0); the file is damaged, export it again"
        )
    if (sizes < 3).any():
        notice(f"{name}: {int((sizes < 3).sum())} faces of fewer than 3 corners are left out")
    if (sizes == 3).all():
        return corners.reshape(-1, 3).astype(np.int64, copy=False)
    starts = np.cumsum(sizes) - sizes
    triangles = np.maximum(sizes - 2, 0)
    rows = np.cumsum(triangles) - triangles  # where the triangles of each polygon begin
    first = np.repeat(starts, triangles)
    step = np.arange(len(first)) - np.repeat(rows, triangles) + 1
    faces = corners[np.stack([first, first + step, first + step + 1], axis=1)].astype(np.int64).reshape(-1, 3)
    with np.errstate(invalid="ignore", over="ignore"):  # triangles with coordinates that are not finite go later
        _turn_diagonals(faces, rows[sizes == 4], vertices)
        large = np.flatnonzero(sizes > 4)
        if len(large):
            _cut_ears(faces, rows[large], starts[large], sizes[large], corners, vertices)
    return faces


def finite_triangles(vertices: np.ndarray, faces: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) and faces (f, 3) without vertices that are NaN or infinite and the triangles that have such.

    Raises
    ------
    BadInput
        If no triangle is left. A notice reports how many are left out.
    """
    finite = np.isfinite(vertices).all(axis=1)
    if finite.all():
        return vertices, faces
    kept = finite[faces].all(axis=1)
    lost, bad = len(faces) - int(kept.sum()), len(finite) - int(finite.sum())
    if not kept.any():
        raise BadInput(
            f"{name}: {bad} of {len(finite)} vertices are NaN or infinite, and all {lost} triangles have one; expected "
            "finite coordinates. Export it again"
        )
    notice(
        f"{name}: {bad} of {len(finite)} vertices are NaN or infinite; they and the {lost} of {len(faces)} triangles "
        "that have one are left out"
    )
    return vertices[finite], (np.cumsum(finite) - 1)[faces[kept]]


def _turn_diagonals(faces: np.ndarray, rows: np.ndarray, V: np.ndarray) -> None:
    """Give quadrangles a b c d, in ``faces`` as a b c and a c d, the diagonal b d where only that one is right."""
    a, b, c, d = (V[corner] for corner in (*faces[rows].T, faces[rows + 1, 2]))
    folded = np.flatnonzero(_dot(np.cross(b - a, c - a), np.cross(c - a, d - a)) < 0)
    a, b, c, d = (corner[folded] for corner in (a, b, c, d))
    rows = rows[folded[_dot(np.cross(c - b, d - b), np.cross(d - b, a - b)) > 0]]
    corners = np.column_stack([faces[rows], faces[rows + 1, 2]])
    faces[rows], faces[rows + 1] = corners[:, [1, 2, 3]], corners[:, [1, 3, 0]]


def _cut_ears(
    faces: np.ndarray, rows: np.ndarray, starts: np.ndarray, sizes: np.ndarray, corners: np.ndarray, V: np.ndarray
) -> None:
    """Replace the fans of polygons of five or more corners that fold over."""
    ends = np.cumsum(sizes)
    begins = ends - sizes
    own = corners[np.arange(ends[-1]) + np.repeat(starts - begins, sizes)]  # the corners of these polygons alone
    P = V[own] - np.repeat(V[corners[starts]], sizes, axis=0)
    following = np.arange(1, len(own) + 1)
    following[ends - 1] = begins
    crosses = np.cross(P, P[following])  # of the triangles of the fan; two of each polygon are 0
    normals = np.add.reduceat(crosses, begins)  # Newell's
    areas = _dot(crosses, np.repeat(normals, sizes, axis=0))
    folded = np.add.reduceat(np.abs(areas), begins) > (1 + ROUNDING) * np.add.reduceat(areas, begins)
    for polygon in np.flatnonzero(folded & normals.any(axis=1) & np.isfinite(normals).all(axis=1)):
        here = slice(begins[polygon], ends[polygon])
        row = rows[polygon]
        faces[row : row + sizes[polygon] - 2] = own[here][_ears(P[here], normals[polygon])]


def _ears(P: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The triangles of one polygon (n, 3), as (n - 2, 3) indices of its corners.

    Corners that nearly coincide need a tolerance, or triangles overlap; how large a one, their areas tell.
    """
    from manifold3d import triangulate as by_ears

    axis = int(np.abs(normal).argmax())
    axes = [(axis + 1) % 3, (axis + 2) % 3]
    if normal[axis] < 0:
        axes.reverse()  # counter-clockwise from either side
    flat = P[:, axes]
    least, best = np.inf, np.empty((0, 3), dtype=np.int64)
    for tolerance in TOLERANCES:
        faces = by_ears([flat], tolerance * float(np.ptp(flat, axis=0).max()) if tolerance else -1.0)
        b, c = flat[faces[:, 1]] - flat[faces[:, 0]], flat[faces[:, 2]] - flat[faces[:, 0]]
        doubled = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
        covered, area = np.abs(doubled).sum(), abs(doubled.sum())
        if covered < least:
            least, best = covered, faces
        if covered <= area * (1 + ROUNDING):
            break
    return best


def _dot(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.einsum("ni,ni->n", u, v)
