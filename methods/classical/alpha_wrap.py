"""Alpha wrapping, by CGAL, and a fit to the points that refines it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import BadInput, PointCloud, Run, register

from .inputs import distinct_points, note_flat
from .isolated import without_isolated

if TYPE_CHECKING:
    from trimesh import Trimesh

NEAR = 2.0  # mean spacings from the points, up to which the wrap moves fully onto them
FAR = 3.0  # beyond this distance it does not move: points are missing there
LEVELS = 4  # subdivisions at most


@register("method", cite="Portaneri et al. 2022; fit: Cazals and Pouget 2005", requires=("CGAL", "scipy", "trimesh"))
@dataclass(frozen=True)
class AlphaWrap:
    """Alpha wrapping, refined: a closed surface carved around the points, then subdivided and fitted to them.

    A ball that is too large for the gaps between the points carves the wrap from outside, and bridges holes.
    The cited method (Portaneri et al. 2022) ends there, with coarse triangles outside of the points: that is
    ``fit=False``, preset ``alpha_wrap_plain``. With ``fit`` this plugin also subdivides the wrap, and moves it
    onto quadrics fitted to the points (Cazals and Pouget 2005). Needs no normals. Always closed, for any points.
    """

    alpha: float = 3.0  # size of the ball in mean spacings: it must not fit through holes, nor skip narrow gaps
    offset: float = 0.5  # distance of the wrap from the points, in mean spacings; thinner parts than this fuse
    fit: bool = True  # whether the wrap is subdivided and moved onto the points; false is the cited method alone
    k: int = 18  # neighbours of a quadric; more remove noise, and detail with it

    def __post_init__(self) -> None:
        if not self.alpha > 0:
            raise ValueError(f"alpha: expected a number above 0, got {self.alpha}")
        if not self.offset > 0:
            raise ValueError(f"offset: expected a number above 0, got {self.offset}")
        if self.k < 6:
            raise ValueError(f"k: a quadric needs at least 6 neighbours, got {self.k}")

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A closed mesh with outward faces; it has two sheets if the ball passed through a hole."""
        from trimesh import Trimesh

        from bench.geometry.spacing import mean_spacing

        cloud, _ = without_isolated(cloud, "alpha_wrap", run)
        points, _ = distinct_points(cloud.points, "alpha_wrap", at_least=4)
        note_flat(points, "alpha_wrap", run, "the wrap is a closed surface of two sides that meet")
        spacing = mean_spacing(points)
        # The cost grows with the square of the extent in units of alpha; with a distant outlier it takes hours.
        if np.ptp(points, axis=0).max() > 3000 * self.alpha * spacing:
            raise BadInput(
                "alpha_wrap: the points extend over more than 3000 times alpha; remove far outliers, or raise alpha"
            )
        mesh = Trimesh(*wrap(points, self.alpha * spacing, self.offset * spacing), process=False)
        if not len(mesh.faces):
            raise BadInput(f"alpha_wrap: the wrap of {len(points)} points is empty; expected points of a surface")
        return self._fit(mesh, points, spacing) if self.fit else mesh

    def _fit(self, mesh: Trimesh, points: np.ndarray, spacing: float) -> Trimesh:
        from scipy.spatial import cKDTree
        from trimesh import Trimesh

        from .quadrics import project_to_quadrics

        tree = cKDTree(points)
        levels = np.ceil(np.log2(mesh.edges_unique_length.mean() / spacing))
        for _ in range(int(np.clip(levels, 0, LEVELS))):
            mesh = mesh.subdivide()
            vertices = np.asarray(mesh.vertices)
            distance = tree.query(vertices)[0] / spacing
            share = np.clip((FAR - distance) / (FAR - NEAR), 0, 1)[:, None]
            drawn = (1 - share) * vertices + share * project_to_quadrics(vertices, tree, self.k)
            mesh = Trimesh(drawn, mesh.faces, process=False)
        return mesh


def wrap(points: np.ndarray, alpha: float, offset: float) -> tuple[np.ndarray, np.ndarray]:
    """The alpha wrap of ``points`` (n, 3): vertices (v, 3) and triangles (f, 3)."""
    from CGAL.CGAL_Alpha_wrap_3 import Point_3_Vector, alpha_wrap_3
    from CGAL.CGAL_Kernel import Point_3
    from CGAL.CGAL_Polyhedron_3 import Polyhedron_3

    from .point_sets import to_mesh

    vector = Point_3_Vector()
    vector.reserve(len(points))
    for point in points.tolist():
        vector.append(Point_3(*point))
    polyhedron = Polyhedron_3()
    alpha_wrap_3(vector, alpha, offset, polyhedron)
    return to_mesh(polyhedron)
