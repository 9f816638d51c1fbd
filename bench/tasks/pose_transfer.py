"""Pose transfer: a character takes the pose of another figure."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from ..contract.case import Case
from ..contract.shape import PoseTransfer as Problem
from ..contract.shape import Shape
from ..contract.task import CaseRecipe, Task, describe_target, generic_words, target_words, validate_deformed
from ..errors import BadInput, UsageError
from ..geometry.cloud import Frame, PointCloud
from ..geometry.plain_mesh import plain_mesh
from ..geometry.shuffling import shuffled
from ..plugins.registry import register
from ..seeds import generator

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("task")
@dataclass(frozen=True)
class PoseTransfer(Task):
    """A character at rest, a template at rest, landmarks on both, and a figure in a pose -> the character in the pose.

    A method is called as ``pose_transfer(source, template, landmarks, target, run)`` and returns a mesh with the faces
    of ``source``, the character, in order. ``landmarks`` are (2, 3) arrays by name: the same place on template and
    character, at rest. ``target`` is a cloud of a figure in the pose, whose build differs from the template's; or a
    mesh in random order; or, with ``corresponding``, the template itself in the pose, vertex by vertex (what
    deformation transfer needs). Cases come from the ``transfers`` of a dataset. No sensor takes part. Vertices and
    faces of the character are in a random order (seeded), so that indices of the template have no meaning there.

    Everything has the scale of the frame of the posed character, is upright, and has its own box centre at the origin.
    Where an output stands does not count: :class:`~bench.metrics.pose_distance_mean.PoseDistanceMean` ignores it.
    """

    output: ClassVar[str] = "mesh"
    promise: ClassVar[str] = "a trimesh.Trimesh with the faces of the source, in order, and finite vertices"
    takes: ClassVar[str] = "none"
    primary: ClassVar[tuple[str, ...]] = ("pose_distance_mean",)
    files: ClassVar[tuple[int, ...]] = (4,)

    target: Literal["cloud", "mesh", "corresponding"] = "cloud"  # the form in which the posed figure is given
    points: int = 5000  # of that cloud

    def __post_init__(self) -> None:
        if self.target not in ("cloud", "mesh", "corresponding"):
            raise ValueError(f"target: expected cloud, mesh or corresponding, got {self.target!r}")
        if self.points < 4:
            raise ValueError(f"points: expected at least 4, got {self.points}")

    def recipes(self, dataset: Any, sensor: Any, *, split: str, count: int, seed: int) -> Iterator[CaseRecipe]:
        """The first ``count`` problems of a dataset's split."""
        if not hasattr(dataset, "transfers"):
            raise UsageError(
                "task pose_transfer: this dataset has no transfers(split); choose one with transfers, like "
                "dataset=humanoids"
            )
        for problem in islice(dataset.transfers(split), count):
            id = f"{problem.id}-pose"
            yield CaseRecipe(id, partial(self._case_of, id, problem, seed))

    def _case_of(self, id: str, problem: Problem, seed: int) -> Case:
        from ..geometry.check import check_mesh

        for shape in (problem.template, problem.character, problem.target):
            check_mesh(shape.mesh, shape.id)
        rng = generator(seed, id, "order")
        character, order, faces = shuffled(problem.character.mesh, rng)
        truth = problem.character_posed.mesh
        posed = problem.character_posed.replace_mesh(plain_mesh(truth.vertices[order], character.faces))
        reference, frame = posed.framed()
        template = _placed(problem.template.mesh, frame.radius)
        landmarks = np.array(list(problem.landmarks.values())).reshape(-1, 2, 3)
        places = [
            (landmarks[:, k] - _middle(mesh)) / frame.radius
            for k, mesh in enumerate((problem.template.mesh, problem.character.mesh))
        ]
        given = {
            "source": _placed(character, frame.radius),
            "template": template,
            "landmarks": dict(zip(problem.landmarks, np.stack(places, axis=1), strict=True)),
            "target": self._target(problem, frame.radius, seed, id),
        }
        return Case(id, given, _with_template(reference, problem, frame), frame, seed, problem.character_posed.tags)

    def _target(self, problem: Problem, size: float, seed: int, id: str) -> Trimesh | PointCloud:
        """The posed figure in the form that a method gets."""
        if self.target == "corresponding":
            return _placed(problem.template_posed.mesh, size)
        rng, mesh = generator(seed, id, "target"), problem.target.mesh
        if self.target == "mesh":
            return _placed(shuffled(mesh, rng)[0], size)
        points, normals = problem.target.surface.sample(self.points, rng)
        return PointCloud((points - _middle(mesh)) / size, normals)

    def expected(self, input: Mapping[str, Any]) -> int:
        """The number of vertices that the faces of the character use."""
        from ..geometry.used import used_vertices

        return len(used_vertices(input["source"]))

    def describe(self, case: Case) -> dict[str, float]:
        """The numbers of vertices of the character and of landmarks, and how far the rest pose is from the truth."""
        from ..geometry.used import is_used

        used = is_used(case.reference.mesh)
        apart = (np.asarray(case.input["source"].vertices) - np.asarray(case.reference.mesh.vertices))[used]
        return describe_target(case.input["target"]) | {
            "source_vertices": float(self.expected(case.input)),
            "landmarks": float(len(case.input["landmarks"])),
            "at_rest": float(np.linalg.norm(apart - apart.mean(axis=0), axis=1).mean()),
        }

    def describe_words(self, medians: Mapping[str, float]) -> str:
        """The same, in a sentence."""
        if "at_rest" not in medians:
            return generic_words(medians)
        return (
            f"characters of {medians['source_vertices']:,.0f} vertices with {medians['landmarks']:.0f} landmarks, at "
            f"rest {medians['at_rest']:.2g} from the truth{target_words(medians)} (medians of the cases)."
        )

    def read(self, paths: Sequence[str]) -> tuple[dict[str, Any], Frame]:
        """The files CHARACTER TEMPLATE LANDMARKS TARGET; the frame is the target's.

        LANDMARKS is JSON: ``{"left_elbow": [[x, y, z], [x, y, z]], ...}``, on the template and on the character. All
        are upright and face the same way.

        Raises
        ------
        UsageError
            For another number of files.
        BadInput
            Naming the file and what was expected of it.
        """
        from ..geometry.io.files import load_cloud, load_mesh
        from ..geometry.used import used_vertices

        if len(paths) != 4:
            given = ", ".join(map(str, paths)) or "none"
            raise UsageError(f"expected the files CHARACTER TEMPLATE LANDMARKS TARGET; got {len(paths)}: {given}")
        character, template = load_mesh(paths[0]), load_mesh(paths[1])
        landmarks = read_landmarks(paths[2])
        if self.target == "cloud":
            cloud = load_cloud(paths[3])
            frame = Frame.of(cloud.points)
            target = PointCloud(frame.apply(cloud.points), cloud.normals)
        else:
            mesh = load_mesh(paths[3])
            if self.target == "corresponding" and not np.array_equal(mesh.faces, template.faces):
                raise BadInput(
                    f"{paths[3]}: its faces differ from those of the template {paths[1]}; expected the template in the "
                    "pose. Use task.target=cloud for another mesh"
                )
            frame = Frame.of(used_vertices(mesh))
            target = plain_mesh(frame.apply(mesh.vertices), mesh.faces)
        middles = np.array([_middle(template), _middle(character)])
        return {
            "source": _placed(character, frame.radius),
            "template": _placed(template, frame.radius),
            "landmarks": {name: (places - middles) / frame.radius for name, places in landmarks.items()},
            "target": target,
        }, frame

    def save(self, output: Trimesh, path: str, paths: Sequence[str]) -> None:
        """Write an output. From OBJ to OBJ, all but the character's coordinates stays: UVs, groups, material."""
        from ..geometry.io.obj_vertices import save_deformed

        save_deformed(output, path, paths[0])

    def validate(self, output: Any, input: dict[str, Any]) -> None:
        """Check an output against the promise."""
        validate_deformed(output, input["source"], self.promise)

    def toy(self) -> Case:
        """A small case for the conformance kit: a long ball bends, and a long block has to bend in the same way."""
        from trimesh.creation import box, icosphere

        from ..geometry.subdivision import divided

        ball = icosphere(subdivisions=3)
        template = plain_mesh(ball.vertices * (0.3, 0.25, 1.0), ball.faces)
        seen = plain_mesh(ball.vertices * (0.33, 0.28, 0.95), ball.faces)
        block = plain_mesh(*divided(*(lambda b: (b.vertices, b.faces))(box((0.5, 0.4, 1.7))), 4))
        ways = icosphere(subdivisions=1).vertices
        flat = np.array([0.25, 0.2, 0.85]) * ways / np.abs(ways).max(axis=1, keepdims=True)
        landmarks = {f"way_{k}": np.stack([ways[k] * (0.3, 0.25, 1.0), flat[k]]) for k in range(len(ways))}
        shapes = (template, _bent(template), _bent(seen), block, _bent(block))
        a, b, c, d, e = (Shape(f"toy-{k}", mesh) for k, mesh in enumerate(shapes))
        problem = Problem("toy", a, b, c, d, e, landmarks)
        return replace(self, points=min(self.points, 1000))._case_of("toy", problem, seed=0)


def read_landmarks(path: str) -> dict[str, np.ndarray]:
    """Landmarks of a JSON file, (2, 3) arrays by name: on the template and on the character.

    Raises
    ------
    BadInput
        Naming the file, and what was expected.
    """
    expected = 'expected JSON like {"left_elbow": [[x, y, z], [x, y, z]]}, on the template and on the character'
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError:
        raise BadInput(f"{path}: is not JSON; {expected}") from None
    if not isinstance(content, dict) or not content:
        raise BadInput(f"{path}: {expected}")
    landmarks = {}
    for name, places in content.items():
        try:
            landmarks[name] = np.array(places, dtype=np.float64)
        except (TypeError, ValueError):
            landmarks[name] = np.empty(0)
        if landmarks[name].shape != (2, 3) or not np.isfinite(landmarks[name]).all():
            raise BadInput(f"{path}: {name} is {str(places)[:60]}; {expected}")
    return landmarks


def _bent(mesh: Trimesh) -> Trimesh:
    return plain_mesh(mesh.vertices + 0.4 * mesh.vertices[:, 2:] ** 2 * np.array([1.0, 0, 0]), mesh.faces)


def _with_template(reference: Shape, problem: Problem, frame: Frame) -> Shape:
    """The reference with the posed template as an attribute: learned methods see it in training."""

    def attributes() -> dict[str, np.ndarray]:
        posed = problem.template_posed.mesh
        return {"template_posed": (posed.vertices - _middle(posed)) / frame.radius}

    return Shape(
        reference.id,
        reference.mesh,
        tags=reference.tags,
        info=reference.info,
        exactness=reference.exactness,
        attributes=attributes,
    )


def _middle(mesh: Trimesh) -> np.ndarray:
    """The box centre."""
    from ..geometry.used import used_vertices

    return np.array(Frame.of(used_vertices(mesh)).center)


def _placed(mesh: Trimesh, size: float) -> Trimesh:
    """A mesh in a unit of ``size``, its box centre at the origin."""
    return plain_mesh((mesh.vertices - _middle(mesh)) / size, mesh.faces)
