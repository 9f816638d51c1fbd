"""The nouns: :class:`PointCloud`, :class:`Shape`, :class:`Surface`, :class:`Frame` and :class:`Case`.

A mesh is a ``trimesh.Trimesh`` made with ``process=False``; there is no mesh class of our own. This module imports
numpy and nothing else, so that plugins, and the commands that only list them, start fast.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from .errors import BadInput

if TYPE_CHECKING:
    from trimesh import Trimesh

    from .geometry.comparison import Comparison


def _rows_of_three(name: str, values: Any) -> np.ndarray:
    array = np.array(values, dtype=np.float64)  # a copy: the cloud owns what it freezes
    if array.ndim != 2 or array.shape[1] != 3:
        raise BadInput(f"PointCloud.{name}: expected an array of shape (N, 3), got {array.shape}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points of a surface, immutable.

    Parameters
    ----------
    points : (N, 3) float64 array
    normals : (N, 3) float64 array of unit length, or None
    colors : (N, 3) float64 array in 0..1, or None

    Raises
    ------
    BadInput
        If an array has another shape, or other than N rows. Values are not judged here: what a *method* returns is
        judged by its task, so that a NaN is recorded as an invalid output.
    """

    points: np.ndarray
    normals: np.ndarray | None = None
    colors: np.ndarray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _rows_of_three("points", self.points))
        for name in ("normals", "colors"):
            values = getattr(self, name)
            if values is None:
                continue
            values = _rows_of_three(name, values)
            if len(values) != len(self.points):
                raise BadInput(f"PointCloud.{name}: {len(values)} rows for {len(self.points)} points")
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        return len(self.points)

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays by name, without those that are None; :meth:`of` makes the same cloud of them."""
        given = {"points": self.points, "normals": self.normals, "colors": self.colors}
        return {name: array for name, array in given.items() if array is not None}

    @classmethod
    def of(cls, arrays: Mapping[str, np.ndarray]) -> PointCloud:
        """The inverse of :meth:`arrays`."""
        return cls(arrays["points"], arrays.get("normals"), arrays.get("colors"))

    def __repr__(self) -> str:
        extras = [name for name in ("normals", "colors") if getattr(self, name) is not None]
        return f"PointCloud({len(self)} points{''.join(', ' + e for e in extras)})"


class Surface(Protocol):
    """A surface that can be sampled and projected to: a mesh, or what a dataset knows exactly."""

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``count`` points, uniform by area, and their outward unit normals: two (count, 3) arrays."""
        ...

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The closest surface point of each of ``points`` (n, 3), and the unit normal there: two (n, 3) arrays."""
        ...


@dataclass(frozen=True)
class Frame:
    """The similarity that takes original coordinates to the frame of a case: ``(x - center) / radius``."""

    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float = 1.0

    @classmethod
    def of(cls, points: np.ndarray) -> Frame:
        """The frame in which ``points`` (n, 3) have their box centre at the origin and the farthest at radius 1."""
        points = np.asarray(points, dtype=np.float64)
        center = (points.min(axis=0) + points.max(axis=0)) / 2
        radius = float(np.sqrt(((points - center) ** 2).sum(axis=1).max()))
        if not radius > 0 or not np.isfinite(radius):
            raise BadInput(f"all {len(points)} points coincide or are not finite: there is no extent to scale to 1")
        return cls(tuple(float(c) for c in center), radius)

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Original coordinates -> the case's frame."""
        return (np.asarray(points, dtype=np.float64) - self.center) / self.radius

    def invert(self, points: np.ndarray) -> np.ndarray:
        """The case's frame -> original coordinates."""
        return np.asarray(points, dtype=np.float64) * self.radius + self.center


class _FramedSurface:
    """A surface seen from another frame."""

    def __init__(self, surface: Surface, frame: Frame):
        self._surface, self._frame = surface, frame

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        points, normals = self._surface.sample(count, rng)
        return self._frame.apply(points), normals

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        closest, normals = self._surface.closest(self._frame.invert(points))
        return self._frame.apply(closest), normals


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
    mesh : Trimesh, or a function without arguments that makes it
        Give the function where making the mesh costs time: a resumed run then skips finished shapes at no cost, and
        a shape that cannot be made fails alone.
    surface : Surface, optional
        What the dataset knows exactly (analytic samples and closest points). Without it the mesh is the truth.
    tags : tuple of str
        Challenge tags, for slices of the leaderboard (``sharp``, ``thin``, ``high_genus``, ``smooth``, ...).
    info : mapping
        Whatever else is known: genus, symmetry, thickness. JSON values.
    exactness : str
        How the truth is known, one of :data:`EXACTNESS`.
    attributes : mapping, or a function without arguments that makes it
        Named arrays that belong to the mesh, a row per vertex or per face, in the coordinates of the dataset: part
        labels, skinning weights, a displacement and the base that it was applied to. Or a row per column of another
        one: the joints of skinning weights.
    """

    def __init__(
        self,
        id: str,
        mesh: Trimesh | Callable[[], Trimesh],
        *,
        surface: Surface | None = None,
        tags: tuple[str, ...] = (),
        info: Mapping[str, Any] | None = None,
        exactness: str = "mesh",
        attributes: Mapping[str, np.ndarray] | Callable[[], Mapping[str, np.ndarray]] | None = None,
    ):
        if exactness not in EXACTNESS:
            raise ValueError(f"exactness: expected one of {', '.join(EXACTNESS)}; got {exactness!r}")
        self.id, self.tags, self.info, self.exactness = id, tuple(tags), dict(info or {}), exactness
        self._mesh, self._surface, self._attributes = mesh, surface, attributes or {}

    @property
    def mesh(self) -> Trimesh:
        """The mesh, made on first use."""
        if callable(self._mesh):
            self._mesh = self._mesh()
        return self._mesh

    @property
    def attributes(self) -> Mapping[str, np.ndarray]:
        """Named arrays that belong to the mesh, made on first use."""
        if callable(self._attributes):
            self._attributes = self._attributes()
        return self._attributes

    @property
    def surface(self) -> Surface:
        """The exact surface if the dataset gave one, otherwise the mesh as a surface."""
        if self._surface is None:
            from .geometry.mesh_surface import MeshSurface

            self._surface = MeshSurface(self.mesh)
        return self._surface

    @property
    def is_exact(self) -> bool:
        """Whether the dataset knows more than the mesh."""
        from .geometry.mesh_surface import MeshSurface

        return not isinstance(self.surface, MeshSurface)

    def replace_mesh(self, mesh: Trimesh | Callable[[], Trimesh]) -> Shape:
        """This shape with another mesh, or another way to make it; all else is shared."""
        return Shape(
            self.id,
            mesh,
            surface=self._surface,
            tags=self.tags,
            info=self.info,
            exactness=self.exactness,
            attributes=lambda: self.attributes,
        )

    def renamed(self, id: str, **info: Any) -> Shape:
        """This shape under another id, with more ``info``; it is made when it is asked for, as before."""
        return Shape(
            id,
            lambda: self.mesh,
            surface=self._surface,
            tags=self.tags,
            info={**self.info, **info},
            exactness=self.exactness,
            attributes=lambda: self.attributes,
        )

    def framed(self) -> tuple[Shape, Frame]:
        """This shape in the one frame of all cases, and the frame: box centre at the origin, farthest vertex at 1.

        Raises
        ------
        BadInput
            If the mesh has no faces, or vertices that are not finite, or no extent.
        """
        from trimesh import Trimesh

        from .geometry.check import check_mesh

        check_mesh(self.mesh, self.id)
        frame = Frame.of(self.mesh.vertices)
        mesh = Trimesh(frame.apply(self.mesh.vertices), self.mesh.faces, process=False)
        surface = None if self._surface is None or not self.is_exact else _FramedSurface(self._surface, frame)
        framed = self.replace_mesh(mesh)
        framed._surface = surface
        return framed, frame

    def __repr__(self) -> str:
        return f"Shape({self.id!r})"


@dataclass(frozen=True, eq=False)
class ShapePair:
    """Two shapes whose meshes have the same faces: vertex i of the one corresponds to vertex i of the other.

    Attributes
    ----------
    id : str
        Unique in its dataset and split, usable as a file name.
    source, target : Shape
    landmarks : mapping from names to vertices
        Points that a person would mark, equal for both.
    """

    id: str
    source: Shape
    target: Shape
    landmarks: Mapping[str, int] = field(default_factory=dict)


@dataclass(eq=False)
class Case:
    """One problem: what the method is given, and the truth.

    Everything is in the frame of the reference (bounding-box centre at the origin, farthest vertex at radius 1); an
    output is never re-normalised.

    Attributes
    ----------
    id : str
    input : mapping
        The keyword arguments of the method's function, for instance ``{"cloud": PointCloud}``.
    reference : Shape
        The truth, in the case's frame.
    frame : Frame
        From the original coordinates to the case's frame.
    seed : int
        Seeds the sampling of the metrics, equal for all methods: comparisons are paired.
    """

    id: str
    input: Mapping[str, Any]
    reference: Shape
    frame: Frame = Frame()
    seed: int = 0
    tags: tuple[str, ...] = ()
    _cache: dict[str, Any] = field(default_factory=dict, repr=False)
    _memo: Any = field(default=None, repr=False)  # a bench.memo.Memo: what the cells of a sweep share

    def remember(self, name: str, make: Callable[[], Mapping[str, np.ndarray]]) -> Mapping[str, np.ndarray]:
        """Arrays that follow from the reference and the seed: from the sweep's memory, or made now."""
        return make() if self._memo is None else self._memo.arrays(name, make)

    def compare(self, output: PointCloud | Trimesh) -> Comparison:
        """The directed distances between ``output`` and the reference, computed once and shared by all metrics."""
        from .geometry.comparison import Comparison

        known = self._cache.setdefault("comparisons", [])
        for comparison in known:
            if comparison.output is output:
                return comparison
        comparison = Comparison(output, self)
        known.append(comparison)
        del known[:-2]  # an output and its perfect twin; a traced run must not collect all its outputs
        return comparison

    def perfect(self, output: PointCloud | Trimesh) -> PointCloud | Trimesh:
        """What a perfect method would have returned in place of ``output``: the reference, in kind and in count.

        A metric's score of it is the metric's *floor*: the number that sampling alone leaves over.
        """
        if not isinstance(output, PointCloud):
            return self.reference.mesh
        key = f"perfect {len(output)}"
        if key not in self._cache:
            self._cache[key] = PointCloud(**self.remember(key, lambda: self._sampled(len(output))))
        return self._cache[key]

    def _sampled(self, count: int) -> Mapping[str, np.ndarray]:
        from .seeds import generator

        points, normals = self.reference.surface.sample(count, generator(self.seed, self.id, "perfect"))
        return {"points": points, "normals": normals}
