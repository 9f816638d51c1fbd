"""Shapes and their exact surfaces: :class:`Shape`, :class:`Surface`, :class:`ShapePair`, :class:`PoseTransfer`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..geometry.cloud import Frame, PointCloud

if TYPE_CHECKING:
    from trimesh import Trimesh

    from ..geometry.traits import Traits


class Surface(Protocol):
    """A surface that can be sampled and projected to: a mesh, or an exact surface given by a dataset.

    Evenly spread points are spaced by the area of the shape's mesh. Where that is wrong (curves, whose mesh is a thin
    ribbon), the surface has ``sample_evenly(count, rng)`` too, which returns exactly ``count`` points and normals.
    """

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``count`` points, uniform by area, and their outward unit normals: two (count, 3) arrays."""
        ...

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The closest surface point of each of ``points`` (n, 3), and the unit normal there: two (n, 3) arrays."""
        ...


class _FramedSurface:
    """A surface in the coordinates of another frame."""

    def __init__(self, surface: Surface, frame: Frame):
        self._surface, self._frame = surface, frame

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        points, normals = self._surface.sample(count, rng)
        return self._frame.apply(points), normals

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        closest, normals = self._surface.closest(self._frame.invert(points))
        return self._frame.apply(closest), normals

    @property
    def sample_evenly(self) -> Callable[[int, np.random.Generator], tuple[np.ndarray, np.ndarray]]:
        """For a surface that spaces points itself; :class:`AttributeError` where it does not."""
        surface: Any = self._surface
        evenly = surface.sample_evenly

        def framed(count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
            points, normals = evenly(count, rng)
            return self._frame.apply(points), normals

        return framed


EXACTNESS = {
    "analytic": "a distance function in closed form",
    "implicit": "an implicit function in closed form, with exact normals and exact foot points",
    "parametric": "a parametrisation in closed form, with exact points and normals",
    "polyhedron": "the mesh is the shape",
    "mesh": "the mesh is all that is known",
}


class Shape:
    """One shape of a dataset.

    Parameters
    ----------
    id : str
        Unique in its dataset and split, usable as a file name (``bumps-test-003``).
    mesh : Trimesh or PointCloud, or a function without arguments that makes it
        Give the function where making the mesh costs time: a resumed run then skips finished shapes at no cost, and
        a shape that cannot be made fails alone. For some shapes only a cloud is
        known, of a better scanner than the one tested: its points are the truth, and metrics of surfaces are left out.
    surface : Surface, optional
        What the dataset knows exactly (analytic samples and closest points). Without it the mesh is the truth.
    tags : tuple of str
        The kind of object (``chair``, ``gear``, ``hand``), for slices of the leaderboard. Properties of its surface
        (``sharp``, ``smooth``, ``thin``, ...) are measured on every shape, not declared: see :attr:`traits`.
    info : mapping
        Further facts: genus, symmetry, thickness. JSON values.
    exactness : str
        How the truth is known, one of :data:`EXACTNESS`.
    attributes : mapping, or a function without arguments that makes it
        Named arrays that belong to the mesh, a row per vertex or per face, in the coordinates of the dataset: part
        labels, skinning weights, a displacement and the base that it was applied to. Or a row per column of another
        one: the joints of skinning weights.
    scan : PointCloud, or a function without arguments that makes it
        A scan that came with the shape, in the coordinates of the mesh: what ``sensor=scan`` gives. A dataset whose
        shapes have one is registered with ``scans=True``.
    """

    def __init__(
        self,
        id: str,
        mesh: Trimesh | PointCloud | Callable[[], Trimesh | PointCloud],
        *,
        surface: Surface | None = None,
        tags: tuple[str, ...] = (),
        info: Mapping[str, Any] | None = None,
        exactness: str = "mesh",
        attributes: Mapping[str, np.ndarray] | Callable[[], Mapping[str, np.ndarray]] | None = None,
        scan: PointCloud | Callable[[], PointCloud | None] | None = None,
    ):
        if exactness not in EXACTNESS:
            raise ValueError(f"exactness: expected one of {', '.join(EXACTNESS)}; got {exactness!r}")
        self.id, self.tags, self.info, self.exactness = id, tuple(tags), dict(info or {}), exactness
        self._mesh, self._surface, self._attributes, self._scan = mesh, surface, attributes or {}, scan

    @property
    def cloud(self) -> PointCloud | None:
        """The points, if only these are known of the shape; None if it has a mesh. Made on first use."""
        made = self._made()
        return made if isinstance(made, PointCloud) else None

    def _made(self) -> Trimesh | PointCloud:
        if callable(self._mesh):
            self._mesh = self._mesh()
        return self._mesh

    @cached_property
    def mesh(self) -> Trimesh:
        """The mesh, made on first use; one of vertices alone where the shape is a cloud."""
        made = self._made()
        if not isinstance(made, PointCloud):
            return made
        from trimesh import Trimesh

        return Trimesh(made.points, process=False)

    @property
    def scan(self) -> PointCloud | None:
        """The scan that came with the shape, made on first use; None where there is none."""
        if callable(self._scan):
            self._scan = self._scan()
        return self._scan

    @property
    def attributes(self) -> Mapping[str, np.ndarray]:
        """Named arrays that belong to the mesh, made on first use."""
        if callable(self._attributes):
            self._attributes = self._attributes()
        return self._attributes

    @property
    def surface(self) -> Surface:
        """The exact surface if the dataset gave one, otherwise the mesh, or the points of a cloud, as a surface."""
        if self._surface is None:
            from ..geometry.cloud_surface import CloudSurface
            from ..geometry.mesh_surface import MeshSurface

            if (cloud := self.cloud) is None:
                self._surface = MeshSurface(self.mesh)
            else:
                self._surface = CloudSurface(cloud)  # type: ignore[assignment]  # one without normals gives None for them
        assert self._surface is not None
        return self._surface

    @cached_property
    def traits(self) -> Traits:
        """Properties of the surface, measured on the mesh in the frame of a case, on first use.

        Raises
        ------
        BadInput
            As :meth:`framed`.
        """
        from ..geometry.traits import measure_traits

        mesh = self.framed()[0].mesh
        return measure_traits(mesh.vertices, mesh.faces)

    @property
    def is_exact(self) -> bool:
        """Whether the dataset gives an exact surface beyond the mesh or the points."""
        from ..geometry.cloud_surface import CloudSurface
        from ..geometry.mesh_surface import MeshSurface

        return not isinstance(self.surface, (MeshSurface, CloudSurface))

    def replace_mesh(self, mesh: Trimesh | PointCloud | Callable[[], Trimesh | PointCloud]) -> Shape:
        """This shape with another mesh, or another way to make it; all else is shared."""
        return Shape(
            self.id,
            mesh,
            surface=self._surface,
            tags=self.tags,
            info=self.info,
            exactness=self.exactness,
            attributes=lambda: self.attributes,
            scan=None if self._scan is None else lambda: self.scan,
        )

    def renamed(self, id: str, **info: Any) -> Shape:
        """This shape under another id, with more ``info``; it is still made on first use."""
        return Shape(
            id,
            lambda: self.mesh if self.cloud is None else self.cloud,
            surface=self._surface,
            tags=self.tags,
            info={**self.info, **info},
            exactness=self.exactness,
            attributes=lambda: self.attributes,
            scan=None if self._scan is None else lambda: self.scan,
        )

    def framed(self) -> tuple[Shape, Frame]:
        """This shape in the common frame of all cases, and the frame: box centre at the origin, farthest vertex at 1.

        Vertices that no face uses are kept, but do not affect the frame. A scan that came with the shape goes into
        the same frame, that of the truth; it is not normalised by itself.

        Raises
        ------
        BadInput
            If the mesh has no faces, or vertices that are not finite, or no extent; if a cloud has < 3 points.
        """
        from trimesh import Trimesh

        from ..geometry.check import check_mesh, check_points
        from ..geometry.used import used_vertices

        if self.cloud is None:
            check_mesh(self.mesh, self.id)
        else:
            check_points(self.cloud.points, self.id, at_least=3)
        frame = Frame.of(used_vertices(self.mesh))
        moved = frame.apply(self.mesh.vertices)
        cloud = self.cloud
        framed = self.replace_mesh(
            Trimesh(moved, self.mesh.faces, process=False) if cloud is None else replace(cloud, points=moved)
        )
        framed._surface = None if self._surface is None or not self.is_exact else _FramedSurface(self._surface, frame)
        if self._scan is not None:

            def moved_scan() -> PointCloud | None:
                scan = self.scan
                return None if scan is None else replace(scan, points=frame.apply(scan.points))

            framed._scan = moved_scan
        return framed, frame

    def __repr__(self) -> str:
        return f"Shape({self.id!r})"


@dataclass(frozen=True, eq=False)
class ShapePair:
    """Two shapes of one kind; usually their meshes have the same faces, and vertices correspond by index.

    Attributes
    ----------
    id : str
        Unique in its dataset and split, usable as a file name.
    source, target : Shape
    landmarks : mapping from names to vertices
        Points that a person would mark, equal for both.
    corresponding : bool
        Whether the meshes have the same faces; pairs of unlike shapes do not.
    """

    id: str
    source: Shape
    target: Shape
    landmarks: Mapping[str, int] = field(default_factory=dict)
    corresponding: bool = True


@dataclass(frozen=True, eq=False)
class PoseTransfer:
    """One problem of pose transfer: a character takes the pose shown by another body.

    All are in the same coordinates, upright and facing the same way.

    Attributes
    ----------
    id : str
        Unique in its dataset and split, usable as a file name.
    template : Shape
        The body that poses are learned on, at rest.
    template_posed : Shape
        The template in the pose; its faces and vertices correspond to the template's.
    target : Shape
        The body shown in the pose: another body, or the posed template.
    character : Shape
        At rest; any mesh.
    character_posed : Shape
        The truth, with the character's faces and vertices.
    landmarks : mapping from names to (2, 3) arrays
        The same place on the template at rest and on the character at rest.
    """

    id: str
    template: Shape
    template_posed: Shape
    target: Shape
    character: Shape
    character_posed: Shape
    landmarks: Mapping[str, np.ndarray] = field(default_factory=dict)
