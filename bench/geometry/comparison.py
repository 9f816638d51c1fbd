"""The distances between one output and the reference of its case, computed once and shared by all metrics.

The four distances::

    output point    -> nearest reference sample      to_reference    kd-tree
    reference sample -> nearest output point         to_output       kd-tree
    output point    -> closest point of the mesh     to_surface      exact, point to triangle
    reference sample -> closest point of the output  from_surface    exact, point to triangle; outputs that are meshes

Largest distances include parts that samples miss, as a spike without area. They use vertices of meshes too, as in
Metro (Cignoni et al. 1998) and MeshLab: those of the output by their distance to the reference mesh, those of the
reference by theirs to the output (a spike is farthest at its tip). Means are over the samples alone.

The first two carry a sampling error: between two independent uniform samples of one surface of area A, with N points
each, the mean distance is ``0.5 sqrt(A / N)`` and the mean squared distance ``A / (pi N)``. That is what the floor of
a metric shows. The third has none, so it is the one for single output points, and the fourth looks the other way.

An output without points (or a mesh without faces) is infinitely far from everything: a mean distance of it is inf, an
F-score 0. Without this the mean of nothing would be left out, or be 0, the best score of all.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..errors import BadInput, InvalidOutput
from ..seeds import generator
from .closest import Closest
from .cloud import PointCloud
from .mesh_surface import MeshSurface
from .neighbours import Nearest, OrderedPoints
from .reference_sample import UNIFORM, sample_reference
from .used import used_vertices

if TYPE_CHECKING:
    from trimesh import Trimesh

    from ..contract.case import Case

SAMPLES = 100_000
NOWHERE = -1  # the index of a nearest point that does not exist


class NeedsSurface(BadInput):
    """A distance to a surface was requested, but the reference is a point cloud."""


class Reference:
    """The common part of all comparisons of a case: the samples of its reference, their kd-tree, the tree of its mesh.

    Samples come from ``case.reference.surface``, so from the exact surface where the dataset knows one; the mesh is
    then a fine tessellation of it, and ``surface`` is measured against the mesh. A perfect cloud shows in the floor
    what the tessellation adds.
    """

    def __init__(self, case: Case, samples: int, sampling: str = UNIFORM):
        self._case, self._shape = case, case.reference
        drawn = sample_reference(case, samples, sampling, "reference")
        self.normals = drawn.get("normals")
        self.points = OrderedPoints(drawn["points"])

    @cached_property
    def mesh(self) -> MeshSurface:
        """The reference mesh as a surface."""
        if not len(self._shape.mesh.faces):
            raise NeedsSurface(f"{self._shape.id}: is a point cloud; expected a mesh as the reference")
        surface = self._shape.surface
        return surface if isinstance(surface, MeshSurface) else MeshSurface(self._shape.mesh)

    @cached_property
    def vertices(self) -> OrderedPoints | None:
        """The vertices of the reference mesh that faces use; None if the reference is a cloud."""
        mesh = self._shape.mesh
        return OrderedPoints(used_vertices(mesh)) if len(mesh.faces) else None

    def normals_at(self, closest: Closest) -> np.ndarray:
        """(n, 3) unit normals of the surface at closest points of the mesh, any face's where several faces meet.

        The faces of a tessellation with edges of length h are tilted against a surface of curvature k by up to k h / 2,
        more than one degree for a bumpy sphere of 80,000 faces: more than good methods differ. If the dataset
        knows the surface, its exact normals at the vertices are interpolated, which errs by a tenth of that.
        """
        if self._vertex_normals is None:
            return self.mesh.normals[closest.faces]
        return self.mesh.interpolate_normals(self._vertex_normals, closest)

    @cached_property
    def _vertex_normals(self) -> np.ndarray | None:
        if not self._shape.is_exact:
            return None
        surface, vertices = self._shape.surface, self._shape.mesh.vertices
        return self._case.remember("vertex normals", lambda: {"normals": surface.closest(vertices)[1]})["normals"]


class Comparison:
    """The comparison of an output with the reference of its case; every distance is computed once, on first use.

    Made by :meth:`bench.Case.compare`.

    Parameters
    ----------
    output : PointCloud, or Trimesh with faces
        In the frame of the case.
    case : Case
        Its seed and id seed the samples, so that all methods get the same sample of the reference.
    samples : int, optional
        How many points are drawn from the reference, and from an output that is a mesh: :data:`SAMPLES`, or the number
        set by :func:`set_samples` for the case.
    sampling : str
        How the points of the reference are spread, see :mod:`reference_sample`.
    """

    def __init__(self, output: PointCloud | Trimesh, case: Case, samples: int | None = None, sampling: str = UNIFORM):
        self.output, self.case, self.sampling = output, case, sampling
        self.samples = case._cache.get("samples", SAMPLES) if samples is None else samples

    @property
    def is_empty(self) -> bool:
        """Whether the output has no points, or is a mesh without faces."""
        return not len(self.output if isinstance(self.output, PointCloud) else self.output.faces)

    @property
    def output_points(self) -> np.ndarray:
        """(n, 3) array: the points of a cloud, or uniform samples of a mesh."""
        return self._output.points

    @property
    def output_normals(self) -> np.ndarray | None:
        """(n, 3) array: the normals of a cloud, None if it has none, or the face normals at the samples of a mesh."""
        return self._output_sample[1]

    @property
    def reference_points(self) -> np.ndarray:
        """(samples, 3) array: samples of the reference surface, the same for every output of the case."""
        return self._reference.points.points

    @property
    def reference_normals(self) -> np.ndarray | None:
        """(samples, 3) array: the unit normals of the surface at :attr:`reference_points`; None of a cloud without."""
        return self._reference.normals

    @property
    def reference_area(self) -> float:
        """The area of the reference mesh."""
        return float(self._reference.mesh.mesh.area)

    @cached_property
    def to_reference(self) -> Nearest:
        """The nearest reference sample of each output point."""
        if self.is_empty:
            return _nowhere(1)
        return self._output.nearest_in(self._reference.points)

    @cached_property
    def to_output(self) -> Nearest:
        """The nearest output point of each reference sample."""
        if self.is_empty:
            return _nowhere(len(self.reference_points))
        return self._reference.points.nearest_in(self._output)

    @cached_property
    def to_surface(self) -> Closest:
        """The closest point of the reference mesh to each output point, exact: distance, point and face."""
        if self.is_empty:
            return _closest_nowhere(1)
        return self._reference.mesh.project(self._output)

    @cached_property
    def from_surface(self) -> Closest:
        """The closest point of the output, a mesh, to each reference sample, exact: distance, point and face."""
        if self.is_empty:
            return _closest_nowhere(len(self.reference_points))
        return self._output_surface.project(self._reference.points)

    # -- largest distances ---------------------------------------------------------------------------------------------

    @property
    def to_reference_max(self) -> float:
        """The largest distance of the output to the reference: of :attr:`to_reference`, and of an output's vertices."""
        return max(float(self.to_reference.distance.max()), self._vertices_to_reference)

    @property
    def to_surface_max(self) -> float:
        """The largest distance of the output to the reference mesh: of :attr:`to_surface`, and of its vertices."""
        return max(float(self.to_surface.distance.max()), self._vertices_to_reference)

    @property
    def to_output_max(self) -> float:
        """The largest distance of the reference to the output: of :attr:`to_output`, and of the mesh's vertices."""
        return max(float(self.to_output.distance.max()), self._vertices_to_output)

    @property
    def from_surface_max(self) -> float:
        """The largest distance of the reference to an output mesh: of :attr:`from_surface`, and of its vertices."""
        return max(float(self.from_surface.distance.max()), self._vertices_to_output)

    @cached_property
    def _vertices_to_reference(self) -> float:
        """Of a mesh, the largest distance of its vertices to the reference mesh, or to the points of a cloud."""
        if self.is_empty or isinstance(self.output, PointCloud):
            return 0.0
        vertices = OrderedPoints(used_vertices(self.output))
        if self._reference.vertices is None:
            return float(vertices.nearest_in(self._reference.points).distance.max())
        return float(self._reference.mesh.project(vertices).distance.max())

    @cached_property
    def _vertices_to_output(self) -> float:
        """The largest distance of the vertices of the reference mesh to the output, a mesh or the points of a cloud."""
        vertices = self._reference.vertices
        if self.is_empty or vertices is None:
            return 0.0
        if isinstance(self.output, PointCloud):
            return float(vertices.nearest_in(self._output).distance.max())
        return float(self._output_surface.project(vertices).distance.max())

    # -- normals, and what all is made of ------------------------------------------------------------------------------

    @cached_property
    def surface_normals(self) -> np.ndarray:
        """(n, 3) array: the unit normal of the reference surface at the closest point to each output point."""
        return self._reference.normals_at(self.to_surface)

    @cached_property
    def _reference(self) -> Reference:
        key = f"{self.sampling} reference {self.samples}"
        if key not in self.case._cache:
            self.case._cache[key] = Reference(self.case, self.samples, self.sampling)
        return self.case._cache[key]

    @cached_property
    def _output_surface(self) -> MeshSurface:
        assert not isinstance(self.output, PointCloud)
        return MeshSurface(self.output)

    @cached_property
    def _output(self) -> OrderedPoints:
        return OrderedPoints(self._output_sample[0])

    @cached_property
    def _output_sample(self) -> tuple[np.ndarray, np.ndarray | None]:
        if isinstance(self.output, PointCloud):
            return self.output.points, self.output.normals
        if self.is_empty:
            return np.empty((0, 3)), np.empty((0, 3))
        surface = self._output_surface
        if not surface.normals.any():
            raise InvalidOutput(f"all {len(self.output.faces)} faces of the mesh are degenerate: it has no area")
        # A stream of its own: the reference mesh itself, given as an output, must get other points than the reference.
        return surface.sample(self.samples, generator(self.case.seed, self.case.id, "output"))


def compare(output: PointCloud | Trimesh, case: Case, samples: int, sampling: str = UNIFORM) -> Comparison:
    """A comparison with other samples, for the conventions that fix their number or spread; shared like the usual one.

    0 samples are the usual number.
    """
    samples = samples or case.compare(output).samples
    if sampling == UNIFORM and samples == case.compare(output).samples:
        return case.compare(output)
    known = case._cache.setdefault(f"comparisons with {samples} {sampling}", [])
    for comparison in known:
        if comparison.output is output:
            return comparison
    known.append(Comparison(output, case, samples, sampling))
    del known[:-2]
    return known[-1]


def set_samples(case: Case, samples: int) -> None:
    """Set the default number of points of the comparisons of a case; before the first one."""
    case._cache["samples"] = samples


def _nowhere(count: int) -> Nearest:
    return Nearest(np.full(count, np.inf), np.full(count, NOWHERE))


def _closest_nowhere(count: int) -> Closest:
    return Closest(np.full(count, np.inf), np.full((count, 3), np.nan), np.full(count, NOWHERE))
