"""The distances between one output and the reference of its case, computed once and shared by all metrics.

Which is measured how::

    output point    -> nearest reference sample      to_reference    kd-tree
    reference sample -> nearest output point         to_output       kd-tree
    output point    -> closest point of the mesh     to_surface      exact, point to triangle

The first two carry a sampling error: between two independent uniform samples of one surface of area A, with N points
each, the mean distance is ``0.5 sqrt(A / N)`` and the mean squared distance ``A / (pi N)``. That is what the floor of
a metric shows. The third has none, so it is the one for single output points.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InvalidOutput
from ..seeds import generator
from ..shapes import Case, PointCloud
from .closest import Closest
from .mesh_surface import MeshSurface
from .neighbours import Nearest, OrderedPoints

if TYPE_CHECKING:
    from trimesh import Trimesh

SAMPLES = 100_000


class Reference:
    """What all comparisons of a case share: the samples of its reference, their kd-tree, the tree of its mesh.

    Samples come from ``case.reference.surface``, so from the exact surface where the dataset knows one; the mesh is
    then a fine tessellation of it, and ``surface`` is measured against the mesh. A perfect cloud shows in the floor
    what the tessellation adds.
    """

    def __init__(self, case: Case, samples: int):
        rng = generator(case.seed, case.id, "reference")
        points, self.normals = case.reference.surface.sample(samples, rng)
        self.points = OrderedPoints(points)
        self._shape = case.reference

    @cached_property
    def mesh(self) -> MeshSurface:
        """The reference mesh as a surface."""
        surface = self._shape.surface
        return surface if isinstance(surface, MeshSurface) else MeshSurface(self._shape.mesh)

    def normals_at(self, closest: Closest) -> np.ndarray:
        """(n, 3) unit normals of the surface at closest points of the mesh, any face's where several faces meet.

        The faces of a tessellation with edges of length h are tilted against a surface of curvature k by up to k h / 2,
        more than one degree for a bumpy sphere of 80,000 faces: more than good methods are apart. Where the dataset
        knows the surface, its exact normals at the vertices are interpolated, which errs by a tenth of that.
        """
        if self._vertex_normals is None:
            return self.mesh.normals[closest.faces]
        return self.mesh.interpolate_normals(self._vertex_normals, closest)

    @cached_property
    def _vertex_normals(self) -> np.ndarray | None:
        return self._shape.surface.closest(self._shape.mesh.vertices)[1] if self._shape.is_exact else None


class Comparison:
    """An output held against the reference of its case; every distance is computed when first asked for, once.

    Made by :meth:`bench.Case.compare`.

    Parameters
    ----------
    output : PointCloud, or Trimesh with faces
        In the frame of the case.
    case : Case
        Its seed and id seed the samples, so that all methods meet the same sample of the reference.
    samples : int
        How many points are drawn from the reference, and from an output that is a mesh.
    """

    def __init__(self, output: PointCloud | Trimesh, case: Case, samples: int = SAMPLES):
        self.output, self.case, self.samples = output, case, samples

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
        """(samples, 3) array: uniform samples of the reference surface, the same for every output of the case."""
        return self._reference.points.points

    @property
    def reference_normals(self) -> np.ndarray:
        """(samples, 3) array: the unit normals of the surface at :attr:`reference_points`."""
        return self._reference.normals

    @cached_property
    def to_reference(self) -> Nearest:
        """The nearest reference sample of each output point."""
        return self._output.nearest_in(self._reference.points)

    @cached_property
    def to_output(self) -> Nearest:
        """The nearest output point of each reference sample."""
        return self._reference.points.nearest_in(self._output)

    @cached_property
    def to_surface(self) -> Closest:
        """The closest point of the reference mesh to each output point, exact: distance, point and face."""
        return self._reference.mesh.project(self._output)

    @cached_property
    def surface_normals(self) -> np.ndarray:
        """(n, 3) array: the unit normal of the reference surface at the closest point to each output point."""
        return self._reference.normals_at(self.to_surface)

    @cached_property
    def _reference(self) -> Reference:
        key = f"reference {self.samples}"
        if key not in self.case._cache:
            self.case._cache[key] = Reference(self.case, self.samples)
        return self.case._cache[key]

    @cached_property
    def _output(self) -> OrderedPoints:
        return OrderedPoints(self._output_sample[0])

    @cached_property
    def _output_sample(self) -> tuple[np.ndarray, np.ndarray | None]:
        if isinstance(self.output, PointCloud):
            return self.output.points, self.output.normals
        surface = MeshSurface(self.output)
        if not surface.normals.any():
            raise InvalidOutput(f"all {len(self.output.faces)} faces of the mesh are degenerate: it has no area")
        # A stream of its own: the reference mesh itself, given as an output, must get other points than the reference.
        return surface.sample(self.samples, generator(self.case.seed, self.case.id, "output"))
