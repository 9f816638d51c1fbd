"""Alpha shapes, on SciPy's Delaunay tetrahedra.

Open3D has them too, but does not distinguish the outer sheet of a surface from the inner one, orients faces randomly
where the two touch, and has gaps on planes, where its Delaunay tetrahedra are incomplete.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import BadInput, PointCloud, Run, register

from .inputs import ROUNDING, distinct_oriented, in_plane, note_flat
from .isolated import without_isolated

if TYPE_CHECKING:
    from scipy.spatial import Delaunay
    from trimesh import Trimesh

# The facets of a tetrahedron, each opposite to the corner with its index.
FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])


@register("method", cite="Edelsbrunner and Mücke 1994", requires=("scipy", "trimesh"))
@dataclass(frozen=True)
class AlphaShape:
    """Alpha shapes: the triangles between points that lie on an empty ball of radius alpha, as seen from outside.

    The mesh passes through points of the input, and is as noisy as they are. Cavities that no ball of radius alpha can
    enter count as solid: the inner sheet of a closed surface is omitted. If a ball enters through a hole, noise
    gives the surface an outer and an inner sheet.
    """

    alpha: float = 1.75  # radius of the ball in mean spacings; smaller opens holes, larger bridges hollows

    def __post_init__(self) -> None:
        if not self.alpha > 0:
            raise ValueError(f"alpha: expected a number above 0, got {self.alpha}")

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """Closed and outward, though it may touch itself; open single sheets face along the normals of the points."""
        from scipy.spatial import Delaunay
        from trimesh import Trimesh

        from bench.geometry.spacing import mean_spacing

        cloud, _ = without_isolated(cloud, "alpha_shape", run)
        points, normals, _ = distinct_oriented(cloud, "alpha_shape", at_least=4)
        spacing = mean_spacing(points)
        plane = in_plane(points, ROUNDING * spacing)
        if plane is None:
            note_flat(points, "alpha_shape", run, "noise gives its surface two sides")
            # Qhull loses precision far from the origin.
            border, sheet = sheets(Delaunay(points - points.mean(axis=0)), self.alpha * spacing)
        else:
            border, sheet = np.empty((0, 3), dtype=int), flat_sheet(plane, self.alpha * spacing)
        a, b, c = (points[sheet[:, k]] for k in range(3))
        wrong = np.einsum("ni,ni->n", np.cross(b - a, c - a), normals[sheet].sum(axis=1)) < 0
        faces = np.concatenate([border, np.where(wrong[:, None], sheet[:, ::-1], sheet)])
        if not len(faces):
            raise BadInput(f"alpha_shape: no empty ball touches three of the {len(points)} points; raise alpha")
        used, faces = np.unique(faces, return_inverse=True)
        return Trimesh(points[used], faces.reshape(-1, 3), process=False)


def sheets(cells: Delaunay, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """The outward faces of solids, and faces with space on both sides, of any orientation: two (f, 3) int arrays."""
    closed = facet_values(cells) <= radius
    reached = _reached_from_outside(~closed, cells.neighbors)
    inner, outer = ~reached[:-1, None], reached[cells.neighbors]  # the last entry, -1, is the outside
    once = cells.neighbors < np.arange(len(cells.simplices))[:, None]
    return _facets(cells, inner & outer), _facets(cells, closed & ~inner & outer & once)


def flat_sheet(plane: np.ndarray, radius: float) -> np.ndarray:
    """The triangles (f, 3) between points of a plane, an (n, 2) array, that lie on an empty ball of that radius."""
    from scipy.spatial import Delaunay

    faces = Delaunay(plane).simplices
    points = np.column_stack([plane, np.zeros(len(plane))])
    return faces[circumcircles(*(points[faces[:, corner]] for corner in range(3)))[1] <= radius]


def facet_values(cells: Delaunay) -> np.ndarray:
    """The radius of the smallest empty ball through each facet: an (n, 4) array.

    Entry (i, k) is the facet of tetrahedron i opposite to its corner k.
    """
    points, corners, neighbors = cells.points, cells.simplices, cells.neighbors
    radii = np.append(circumradii(points[corners]), np.inf)
    a, b, c = (points[corners[:, FACES[:, k]]] for k in range(3))
    center, radius = circumcircles(a, b, c)
    # The sum of a tetrahedron's corners without those of the facet is the corner opposite to it.
    facet_sums = corners[:, FACES].sum(axis=2)
    beyond = np.where(neighbors < 0, corners, corners.sum(axis=1)[neighbors] - facet_sums)
    gaps = np.stack([np.linalg.norm(points[opposite] - center, axis=2) for opposite in (corners, beyond)])
    with_point_inside = gaps.min(axis=0) < radius
    return np.where(with_point_inside, np.minimum(radii[:-1, None], radii[neighbors]), radius)


def circumradii(corners: np.ndarray) -> np.ndarray:
    """The radii of the balls through tetrahedra, infinite for flat ones: (n, 4, 3) array -> (n,) array."""
    a, b, c = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)
    six_volumes = np.einsum("ni,ni->n", a, np.cross(b, c))
    squares = [np.einsum("ni,ni->n", edge, edge)[:, None] for edge in (a, b, c)]
    center = squares[0] * np.cross(b, c) + squares[1] * np.cross(c, a) + squares[2] * np.cross(a, b)
    with np.errstate(divide="ignore", invalid="ignore"):
        radii = np.linalg.norm(center, axis=1) / np.abs(2 * six_volumes)
    return np.where(np.isfinite(radii), radii, np.inf)


def circumcircles(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centers and radii of the circles through the corners of triangles; the radius of a flat one is infinite.

    Parameters
    ----------
    a, b, c : (..., 3) arrays

    Returns
    -------
    centers : (..., 3) array
    radii : (...) array
    """
    u, v = b - a, c - a
    normal = np.cross(u, v)
    square_u, square_v, area = (np.einsum("...i,...i->...", x, x)[..., None] for x in (u, v, normal))
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = (square_u * np.cross(v, normal) + square_v * np.cross(normal, u)) / (2 * area)
    radii = np.linalg.norm(offset, axis=-1)
    return a + offset, np.where(np.isfinite(radii), radii, np.inf)


def _facets(cells: Delaunay, chosen: np.ndarray) -> np.ndarray:
    """The chosen (n, 4) facets as an (f, 3) int array of points, oriented outward from their tetrahedra."""
    cell, facet = np.nonzero(chosen)
    faces = np.take_along_axis(cells.simplices[cell], FACES[facet], axis=1)
    a, b, c = (cells.points[faces[:, k]] for k in range(3))
    opposite = cells.points[cells.simplices[cell, facet]]
    inward = np.einsum("ni,ni->n", np.cross(b - a, c - a), opposite - a) > 0
    return np.where(inward[:, None], faces[:, ::-1], faces)


def _reached_from_outside(open_: np.ndarray, neighbors: np.ndarray) -> np.ndarray:
    """Which tetrahedra are connected to the outside through ``open_`` (n, 4) facets.

    Returns
    -------
    (n + 1,) bool array
        The last entry is the outside, which is number -1 in ``neighbors`` (n, 4).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(open_)
    cell, facet = np.nonzero(open_)
    end = neighbors[cell, facet] % (count + 1)
    graph = coo_array((np.ones(len(cell)), (cell, end)), shape=(count + 1, count + 1))
    _, component = connected_components(graph, directed=False)
    return component == component[-1]
