"""Deformation: a source mesh takes the shape of a target and keeps its faces and its details."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from ..contract.case import Case
from ..contract.shape import Shape, ShapePair
from ..contract.task import CaseRecipe, Task, describe_target, generic_words, target_words, validate_deformed
from ..errors import BadInput, UsageError
from ..geometry.cloud import Frame, PointCloud
from ..geometry.one_view import depth_points, mirrored
from ..geometry.plain_mesh import plain_mesh
from ..geometry.shuffling import shuffled
from ..plugins.registry import register
from ..seeds import generator

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("task")
@dataclass(frozen=True)
class Deform(Task):
    """A source mesh and a target -> the source with other vertices and the same faces, in the shape of the target.

    A method is called as ``deform(source, target, run)`` and returns a mesh with the faces of ``source``, in order.
    Cases come from the ``pairs`` of a dataset. No sensor takes part, and no correspondence is given: the target is a
    cloud sampled from it, or a mesh whose vertices and faces are in a random order (seeded), so that copying by index
    does not work; or, with ``depth``, the points of one depth image and their mirror image at x = 0, for a target that
    is seen from one side only (in figure 5.7 of the thesis, a network predicts a cloud from an image). The reference
    is the pair's target; where its vertices correspond to the source's, metrics may compare them one by one.

    Everything is in the frame of the target (box centre at the origin, farthest vertex at radius 1). The source has its
    own box centre at the origin. With ``scaled``, its box gets the longest edge of the target's box, since both fit a
    unit box in Neural Cages (Wang et al. 2020); without, the source keeps its size relative to the target (bodies).
    """

    output: ClassVar[str] = "mesh"
    promise: ClassVar[str] = "a trimesh.Trimesh with the faces of the source, in order, and finite vertices"
    takes: ClassVar[str] = "none"
    primary: ClassVar[tuple[str, ...]] = ("chamfer_l2_sum", "cot_laplacian_per_area")
    files: ClassVar[tuple[int, ...]] = (2,)

    target: Literal["cloud", "mesh", "depth"] = "cloud"  # the form in which the target is given
    points: int = 5000  # of that cloud
    vertices: int = 5000  # of the source, at least: its faces are divided into four until it has that many
    scaled: bool = True  # whether the source is made as large as the target

    def __post_init__(self) -> None:
        if self.target not in ("cloud", "mesh", "depth"):
            raise ValueError(f"target: expected cloud, mesh or depth, got {self.target!r}")
        if self.points < 4:
            raise ValueError(f"points: expected at least 4, got {self.points}")
        if not 0 <= self.vertices <= 200_000:
            raise ValueError(f"vertices: expected 0 to 200000, got {self.vertices}")

    def recipes(self, dataset: Any, sensor: Any, *, split: str, count: int, seed: int) -> Iterator[CaseRecipe]:
        """The first ``count`` pairs of a dataset's split."""
        if not hasattr(dataset, "pairs"):
            raise UsageError(
                "task deform: this dataset has no pairs(split); choose one with pairs of shapes, like "
                "dataset=furniture, vases or humanoids"
            )
        for pair in islice(dataset.pairs(split), count):
            id = f"{pair.id}-deform"  # not the pair's own: other tasks over the same pairs have cases too
            yield CaseRecipe(id, partial(self._case_of, id, pair, seed))

    def _case_of(self, id: str, pair: ShapePair, seed: int) -> Case:
        from ..geometry.check import check_mesh
        from ..geometry.subdivision import divided

        check_mesh(pair.source.mesh, pair.source.id)
        source, target = pair.source.mesh, pair.target
        rounds = _rounds(source, self.vertices)
        vertices, faces = divided(source.vertices, source.faces, rounds)
        if pair.corresponding and rounds:
            check_mesh(target.mesh, target.id)
            target = target.replace_mesh(plain_mesh(*divided(target.mesh.vertices, target.mesh.faces, rounds)))
        reference, frame = target.framed()
        given = self._target(reference, seed, id)
        return Case(
            id, self._input(plain_mesh(vertices, faces), given, frame), reference, frame, seed, pair.target.tags
        )

    def _target(self, reference: Shape, seed: int, id: str) -> Trimesh | PointCloud:
        """The target in the form that a method gets, in its frame."""
        rng = generator(seed, id, "target")
        if self.target == "cloud":
            return PointCloud(*reference.surface.sample(self.points, rng))
        if self.target == "depth":
            whole = mirrored(depth_points(reference.mesh))
            if not len(whole):
                raise BadInput(f"{id}: a depth image from the front left does not show the target")
            rows = rng.permutation(len(whole))[: self.points]
            assert whole.normals is not None
            return PointCloud(whole.points[rows], whole.normals[rows])
        return shuffled(reference.mesh, rng)[0]

    def _input(self, source: Trimesh, target: Trimesh | PointCloud, frame: Frame) -> dict[str, Any]:
        """The arguments of the method's function; the target is in the frame already, the source is not."""
        from ..geometry.used import used_vertices

        used = used_vertices(source)
        own, scale = Frame.of(used), frame.radius
        if self.scaled:
            theirs = target.points if isinstance(target, PointCloud) else used_vertices(target)
            scale = np.ptp(used, axis=0).max() / np.ptp(theirs, axis=0).max()
        return {"source": plain_mesh((source.vertices - own.center) / scale, source.faces), "target": target}

    def expected(self, input: Mapping[str, Any]) -> int:
        """The number of vertices that the faces of the source use."""
        from ..geometry.used import used_vertices

        return len(used_vertices(input["source"]))

    def describe(self, case: Case) -> dict[str, float]:
        """The numbers of vertices and faces of the source, and of the given points or vertices of the target."""
        source = case.input["source"]
        own = {"source_vertices": float(self.expected(case.input)), "source_faces": float(len(source.faces))}
        return own | describe_target(case.input["target"])

    def describe_words(self, medians: Mapping[str, float]) -> str:
        """The same, in a sentence."""
        if "source_vertices" not in medians:
            return generic_words(medians)
        given = target_words(medians)
        return f"sources of {medians['source_vertices']:,.0f} vertices{given} (medians of the cases)."

    def read(self, paths: Sequence[str]) -> tuple[dict[str, Any], Frame]:
        """The mesh SOURCE and the TARGET, a mesh or a cloud; the frame is the target's.

        The source is not divided: its faces are those of the file.

        Raises
        ------
        UsageError
            For another number of files.
        BadInput
            Naming the file and what was expected of it.
        """
        from ..geometry.io.files import load_cloud, load_mesh
        from ..geometry.used import used_vertices

        if len(paths) != 2:
            given = ", ".join(map(str, paths)) or "none"
            raise UsageError(f"expected the files SOURCE TARGET; got {len(paths)}: {given}")
        source = load_mesh(paths[0])
        target = _target_of(paths[1], load_mesh, load_cloud)
        frame = Frame.of(target.points if isinstance(target, PointCloud) else used_vertices(target))
        if isinstance(target, PointCloud):
            target = PointCloud(frame.apply(target.points), target.normals)
        else:
            target = plain_mesh(frame.apply(target.vertices), target.faces)
            if self.target != "mesh":
                target = PointCloud(*Shape("target", target).surface.sample(self.points, generator(0, "target")))
        return self._input(source, target, frame), frame

    def save(self, output: Trimesh, path: str, paths: Sequence[str]) -> None:
        """Write an output. From OBJ to OBJ, all but the source's coordinates stays: UVs, groups, material."""
        from ..geometry.io.obj_vertices import save_deformed

        save_deformed(output, path, paths[0])

    def validate(self, output: Any, input: dict[str, Any]) -> None:
        """Check an output against the promise."""
        validate_deformed(output, input["source"], self.promise)

    def toy(self) -> Case:
        """A small case for the conformance kit: a ball of 642 vertices, and as target an egg with a dent."""
        from trimesh.creation import icosphere

        ball = icosphere(subdivisions=3)
        dent = 1 - 0.2 * np.exp(-4 * ((ball.vertices - (1, 0, 0)) ** 2).sum(axis=1))
        egg = plain_mesh(ball.vertices * (0.7, 0.85, 1.2) * dent[:, None], ball.faces)
        pair = ShapePair("toy", Shape("toy-source", ball), Shape("toy-target", egg, tags=("smooth",)))
        return replace(self, points=min(self.points, 1000), vertices=0)._case_of("toy", pair, seed=0)


def _rounds(mesh: Trimesh, least: int) -> int:
    """How often to divide the faces to reach ``least`` vertices; a division adds one for each edge."""
    from ..geometry.used import used_vertices

    count, edges, faces, rounds = len(used_vertices(mesh)), len(mesh.edges_unique), len(mesh.faces), 0
    while count < least:
        count, edges, faces, rounds = count + edges, 2 * edges + 3 * faces, 4 * faces, rounds + 1
        if rounds > 8:
            raise BadInput(
                f"the source has {len(mesh.vertices)} vertices; subdividing it to {least} takes too many rounds; "
                "use a finer mesh or a smaller task.vertices"
            )
    return rounds


def _target_of(path: str, load_mesh: Callable, load_cloud: Callable) -> Trimesh | PointCloud:
    """A mesh if the file has faces, else its points."""
    cloud = load_cloud(path)  # refuses damaged files, with or without faces
    try:
        return load_mesh(path)
    except BadInput:
        return cloud
