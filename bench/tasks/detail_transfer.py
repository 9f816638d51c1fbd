"""Detail transfer: the details of one shape on the base of another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..contract.case import Case
from ..contract.shape import Shape, ShapePair
from ..contract.task import CaseRecipe, Task, generic_words, validate_mesh
from ..errors import BadInput, UsageError
from ..geometry.cloud import Frame
from ..geometry.plain_mesh import plain_mesh
from ..plugins.registry import register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("task")
@dataclass(frozen=True)
class DetailTransfer(Task):
    """A detailed mesh, its base and another base -> that other base with the same details.

    A method is called as ``detail_transfer(source, source_base, target_base, run)`` with three meshes, and returns a
    mesh with any number of vertices and faces. Cases come from the ``pairs`` of a dataset whose
    shapes have the attribute ``base_vertices`` (v, 3): the source's mesh and base, and the target's base; the pair's
    target, with its exact surface where one is known, is the reference. No sensor takes part.

    Everything is in the frame of the reference (box centre at the origin, farthest vertex at radius 1). The source is
    scaled by the same factor, so that a displacement has the same length on source and target, and has its own box
    centre at the origin. It is also rotated: detail transfer is defined for aligned shapes (the descriptors of
    implicit displacement fields are normals, which rotate with a shape), and a dataset may rotate each shape at random.
    The source gets the rotation that brings its base vertices nearest to the target's, which correspond to them one to
    one (:func:`bench.geometry.alignment.rotation_between`).

    Without ``bases``, ``source_base`` is None and a method has to separate base and details itself. The target is still
    a bare base, since a dataset's target has the source's details and would be the answer; in the literature's version
    of that problem the target has details of its own, which are replaced.
    """

    output: ClassVar[str] = "mesh"
    promise: ClassVar[str] = "a trimesh.Trimesh with faces and finite vertices"
    takes: ClassVar[str] = "none"
    primary: ClassVar[tuple[str, ...]] = ("surface_distance_mean",)
    files: ClassVar[tuple[int, ...]] = (2, 3)

    bases: bool = True  # whether the source's base is given; if not, a method has to estimate it from the source

    def recipes(self, dataset: Any, sensor: Any, *, split: str, count: int, seed: int) -> Iterator[CaseRecipe]:
        """The first ``count`` pairs of a dataset's split."""
        if not hasattr(dataset, "pairs"):
            raise UsageError(
                "task detail_transfer: this dataset has no pairs(split); choose one with pairs of shapes that have "
                "their base, like dataset=reliefs"
            )
        for pair in islice(dataset.pairs(split), count):
            # Not the pair's own id: the id names the cache of a case and the file of its reference, and a
            # shape, or a case of another task over the same pairs, may use the pair's id.
            id = f"{pair.id}-transfer"
            yield CaseRecipe(id, partial(self._case_of, id, pair, seed))

    def _case_of(self, id: str, pair: ShapePair, seed: int) -> Case:
        from ..geometry.alignment import rotation_between
        from ..geometry.check import check_mesh
        from ..geometry.used import is_used

        reference, frame = pair.target.framed()
        check_mesh(pair.source.mesh, pair.source.id)
        source_base, target_base = _base(pair.source), _base(pair.target)
        if len(source_base) != len(target_base):
            raise BadInput(
                f"{pair.id}: the bases have {len(source_base)} and {len(target_base)} vertices; expected equal numbers"
            )
        used = is_used(pair.source.mesh)
        turn = rotation_between(source_base[used], target_base[used]).T
        source, source_base = pair.source.mesh.vertices @ turn, source_base @ turn
        given = self._input(
            plain_mesh(source, pair.source.mesh.faces),
            plain_mesh(source_base, pair.source.mesh.faces),
            plain_mesh(target_base, pair.target.mesh.faces),
            frame,
        )
        return Case(id, given, reference, frame, seed, pair.target.tags)

    def _input(self, source: Trimesh, source_base: Trimesh | None, target_base: Trimesh, frame: Frame) -> dict:
        """The arguments of the method's function: the meshes in the frame, the source around its own centre."""
        from ..geometry.used import used_vertices

        own = Frame(Frame.of(used_vertices(source)).center, frame.radius)
        return {
            "source": plain_mesh(own.apply(source.vertices), source.faces),
            "source_base": plain_mesh(own.apply(source_base.vertices), source_base.faces)
            if self.bases and source_base is not None
            else None,
            "target_base": plain_mesh(frame.apply(target_base.vertices), target_base.faces),
        }

    def expected(self, input: Mapping[str, Any]) -> int:
        """The number of vertices that the faces of the target's base use."""
        from ..geometry.used import used_vertices

        return len(used_vertices(input["target_base"]))

    def describe(self, case: Case) -> dict[str, float]:
        """The size of the reference's details on the target's base, in the frame.

        Returns
        -------
        dict
            ``detail_rms``: root mean square, over the area of the base, of the distance between a vertex of the base
            and the same vertex of the reference; ``detail_max``: the largest; ``detail_thickness``: from the deepest
            to the highest along the base's vertex normals.
        """
        from ..geometry.used import is_used

        base = case.input["target_base"]
        used = is_used(case.reference.mesh)
        moved = np.where(used[:, None], np.asarray(case.reference.mesh.vertices) - base.vertices, 0.0)
        squared = (moved**2).sum(axis=1)
        area = np.bincount(base.faces.ravel(), np.repeat(base.area_faces / 3, 3), minlength=len(squared))
        height = np.einsum("ni,ni->n", moved, base.vertex_normals)
        return {
            "detail_rms": float(np.sqrt((area * squared).sum() / area.sum())),
            "detail_max": float(np.sqrt(squared.max())),
            "detail_thickness": float(np.ptp(height[used])),
        }

    def describe_words(self, medians: Mapping[str, float]) -> str:
        """The size of the details, in a sentence."""
        if "detail_rms" not in medians:
            return generic_words(medians)
        return (
            f"details to transfer, median of the cases, in radii of the target: {medians['detail_rms']:.2g} root mean "
            f"square, at most {medians['detail_max']:.2g}."
        )

    def read(self, paths: Sequence[str]) -> tuple[dict[str, Any], Frame]:
        """The meshes of ``SOURCE SOURCE_BASE TARGET_BASE``, or of ``SOURCE TARGET_BASE``, and the target's frame.

        There is no reference, so the frame is that of the target's base, and the source is scaled by it, too; its
        radius differs from that of a case only by the details. Nothing is rotated, since vertices of different files
        need not correspond. Align the shapes first.

        Raises
        ------
        UsageError
            For another number of files.
        BadInput
            Naming the file and what was expected of it.
        """
        from ..geometry.io.files import load_mesh
        from ..geometry.used import used_vertices

        if len(paths) not in self.files:
            raise UsageError(
                "expected the mesh files SOURCE SOURCE_BASE TARGET_BASE, or SOURCE TARGET_BASE if the source has no "
                f"base; got {len(paths)}: {', '.join(map(str, paths)) or 'none'}"
            )
        if len(paths) == 3 and not self.bases:
            raise UsageError(f"with task.bases=false the source has no base; leave {paths[1]} out")
        source, *source_base, target_base = (load_mesh(path) for path in paths)
        frame = Frame.of(used_vertices(target_base))
        return self._input(source, source_base[0] if source_base else None, target_base, frame), frame

    def validate(self, output: Any, input: dict[str, Any]) -> None:
        """Check an output against the promise."""
        validate_mesh(output, self.promise)

    def toy(self) -> Case:
        """A small case for the conformance kit: bumps of a ball of 642 vertices, to be transferred to an egg."""
        from trimesh.creation import icosphere

        ball = icosphere(subdivisions=3)
        x, y, z = (4 * ball.vertices).T
        height = 0.05 * np.sin(x) * np.sin(y) * np.sin(z)
        egg = plain_mesh(ball.vertices * (0.8, 0.9, 1.2), ball.faces)
        source, target = (
            Shape(
                f"toy-{name}",
                plain_mesh(base.vertices + height[:, None] * base.vertex_normals, base.faces),
                tags=("smooth",),
                attributes={"base_vertices": np.asarray(base.vertices)},
            )
            for name, base in (("source", ball), ("target", egg))
        )
        return self._case_of("toy", ShapePair("toy", source, target), seed=0)


def _base(shape: Shape) -> np.ndarray:
    """The base vertices (v, 3) of a shape, one for each vertex of its mesh."""
    base = shape.attributes.get("base_vertices")
    if base is None:
        known = ", ".join(sorted(shape.attributes)) or "none"
        raise UsageError(
            f"{shape.id}: has no attribute base_vertices (it has: {known}), and detail_transfer needs shapes that have "
            "their base, like those of dataset=reliefs"
        )
    base = np.asarray(base, dtype=np.float64)
    if base.shape != shape.mesh.vertices.shape:
        raise BadInput(
            f"{shape.id}: base_vertices have the shape {base.shape}; expected {shape.mesh.vertices.shape}, a row for "
            "each vertex of the mesh"
        )
    return base
