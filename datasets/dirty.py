"""Shapes of other families on dirty meshes, with the clean shapes as the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from bench import Shape, ShapePair, generator, register

from .common.dirt import KINDS, Dirt, make_dirt
from .mixture import Mixture

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("dataset", requires=("open3d", "trimesh"))
@dataclass(frozen=True)
class Dirty(Mixture):
    """Shapes of other datasets, in turn, on meshes as people have them: doubled, flipped, cracked; the truth is clean.

    The shapes of ``mixture``, under the same ids, on meshes with vertices that no face uses, duplicated and flipped
    patches, T-junctions, cracks, and faces without an area. None of these moves the surface: samples, normals and
    closest points are those of the clean shape, to rounding. So sensors give the same clouds, and a score that differs
    from the one on ``mixture`` shows how a metric or a method treats the dirt. The dirty mesh is the reference of
    metrics that need a mesh, and the input of methods that take one. Both meshes of a corresponding pair have the same
    dirt, so they still correspond; the first vertices are the clean ones.
    """

    # kinds of dirt; patches of two kinds may overlap
    dirt: list[Literal["unreferenced", "duplicates", "t_junctions", "flipped", "unwelded", "degenerate"]] = field(
        default_factory=lambda: list(KINDS)
    )
    share: float = 0.005  # of the area (patches), the faces (T-junctions, no area) or the vertices (unreferenced)

    def __post_init__(self) -> None:
        super().__post_init__()
        unknown = [kind for kind in self.dirt if kind not in KINDS]
        if unknown or not self.dirt:
            raise ValueError(f"dirt: expected some of {', '.join(KINDS)}; got {unknown or 'none'}")
        if not 0 < self.share <= 0.3:
            raise ValueError(f"share: expected above 0 and up to 0.3, got {self.share}")

    def shapes(self, split: str) -> Iterator[Shape]:
        """The shapes of a split, one of each family in turn."""
        for shape in super().shapes(split):
            yield self._dirty(shape, _MeshDirt(shape, tuple(self.dirt), self.share))

    @property
    def pairs(self) -> Callable[[str], Iterator[ShapePair]]:
        """``pairs(split)``: the pairs of a split, one of each family that has some in turn.

        Raises
        ------
        AttributeError
            Where no family has pairs.
        """
        return partial(self._dirty_pairs, super().pairs)

    def _dirty_pairs(self, clean: Callable[[str], Iterator[ShapePair]], split: str) -> Iterator[ShapePair]:
        for pair in clean(split):
            mesh_dirt = _MeshDirt(pair.source, tuple(self.dirt), self.share)
            other = mesh_dirt if pair.corresponding else _MeshDirt(pair.target, tuple(self.dirt), self.share)
            yield replace(pair, source=self._dirty(pair.source, mesh_dirt), target=self._dirty(pair.target, other))

    def _dirty(self, shape: Shape, mesh_dirt: _MeshDirt) -> Shape:
        return Shape(
            shape.id,
            lambda: mesh_dirt.mesh(shape.mesh),
            surface=_Clean(shape),
            tags=shape.tags,
            info={**shape.info, "dirt": list(self.dirt)},
            exactness=shape.exactness,
            attributes=lambda: mesh_dirt.attributes(shape),
        )


class _MeshDirt:
    """The dirt of one mesh, made on first use; it is valid for other meshes with the same faces."""

    def __init__(self, shape: Shape, kinds: tuple[str, ...], share: float):
        self._shape, self._kinds, self._share = shape, kinds, share

    @cached_property
    def _dirt(self) -> Dirt:
        mesh, rng = self._shape.mesh, generator("dirty", self._shape.id)
        return make_dirt(np.asarray(mesh.vertices), np.asarray(mesh.faces), self._kinds, self._share, rng)

    def mesh(self, clean: Trimesh) -> Trimesh:
        """A clean mesh with the dirt."""
        from trimesh import Trimesh

        return Trimesh(self._dirt.vertices(np.asarray(clean.vertices)), self._dirt.faces, process=False)

    def attributes(self, shape: Shape) -> dict[str, np.ndarray]:
        """The attributes of a clean shape, for its dirty mesh."""
        sizes = len(shape.mesh.vertices), len(shape.mesh.faces)
        return {name: self._dirt.spread(np.asarray(values), *sizes) for name, values in shape.attributes.items()}


class _Clean:
    """The surface of the clean shape, exact or its mesh; a :class:`bench.Surface`."""

    def __init__(self, shape: Shape):
        self._shape = shape

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``count`` points, uniform by area, and their outward unit normals."""
        return self._shape.surface.sample(count, rng)

    def sample_evenly(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``count`` evenly spread points, by the area of the clean mesh, and their outward unit normals."""
        from bench.geometry.poisson_disk import sample_poisson_disk

        return sample_poisson_disk(self._shape, count, rng)

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The foot point of each of ``points`` (n, 3), and the outward unit normal there."""
        return self._shape.surface.closest(points)
