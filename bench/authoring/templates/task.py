"""MyPlugin: say in a line what a method is given, and what it must return."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bench import Case, CaseRecipe, Frame, InvalidOutput, Run, Shape, Task, generator, register, validate_mesh

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("task")
@dataclass(frozen=True)
class MyPlugin(Task):
    """A mesh with noisy vertices -> the same mesh without the noise (replace this by your task)."""

    takes: ClassVar[str] = "none"  # what the sensor must give: "cloud", "views", or "none" (no sensor takes part)
    output: ClassVar[str] = "mesh"  # what a method returns, "mesh" or "cloud"; metrics that do not fit are left out
    promise: ClassVar[str] = "a trimesh.Trimesh with the faces of the input, in their order, and finite vertices"
    files: ClassVar[tuple[int, ...]] = (1,)  # how many input files `detailbench apply` may be given

    noise: float = 0.01  # standard deviation of each coordinate, relative to the radius

    # With takes = "cloud" or "views" leave recipes() out: bench.Task then makes the cases with the sensor.
    def recipes(self, dataset: Any, sensor: Any, *, split: str, count: int, seed: int) -> Iterator[CaseRecipe]:
        """One case for each of the first `count` shapes."""
        for shape in islice(dataset.shapes(split), count):
            yield CaseRecipe(shape.id, partial(self._noisy_case, shape, seed))  # made when it is needed

    def _noisy_case(self, shape: Shape, seed: int) -> Case:
        reference, frame = shape.framed()  # box centre at the origin, farthest vertex at radius 1
        mesh = reference.mesh.copy()
        # Draw from the seed and the shape alone, so that all methods are given the same input.
        mesh.vertices += generator(seed, shape.id, "noise").normal(scale=self.noise, size=mesh.vertices.shape)
        # The keys are the arguments of the method's function: my_plugin(self, mesh, run).
        return Case(shape.id, {"mesh": mesh}, reference, frame, seed, shape.tags)

    def validate(self, output: Any, input: dict[str, Any]) -> None:
        """Raise InvalidOutput with what was promised and what came."""
        validate_mesh(output, self.promise)
        if not np.array_equal(output.faces, input["mesh"].faces):
            raise InvalidOutput(f"promised {self.promise}; got other faces")

    def describe(self, case: Case) -> dict[str, float]:
        """What is measured of every input; stored as input.noise_rms."""
        moved = case.input["mesh"].vertices - case.reference.mesh.vertices
        return {"noise_rms": float(np.sqrt((moved**2).sum(axis=1).mean()))}

    def describe_words(self, medians: Mapping[str, float]) -> str:
        """The sentence below a leaderboard, from the medians of what `describe` measures."""
        return f"input, median of the cases: vertices moved by {medians['noise_rms']:.2g} (RMS)."

    def read(self, paths: Sequence[str]) -> tuple[dict[str, Any], Frame]:
        """For `detailbench apply`: the arguments from the user's files, and the frame that they were scaled to."""
        from bench.geometry.io.files import load_mesh

        mesh = load_mesh(paths[0])
        frame = Frame.of(mesh.vertices)
        mesh.vertices = frame.apply(mesh.vertices)
        return {"mesh": mesh}, frame

    def toy(self) -> Case:
        """A small case, with which `detailbench check` tries the methods of this task."""
        from trimesh.creation import icosphere

        return self._noisy_case(Shape("toy", icosphere(subdivisions=3)), seed=0)


@register("method")
@dataclass(frozen=True)
class MyPluginBaseline:
    """Every vertex at the mean of its neighbours: a simple method to compare others with."""

    steps: int = 1  # how many times

    def my_plugin(self, mesh: Trimesh, run: Run) -> Trimesh:
        """The function that solves the task has the name of the task."""
        from trimesh import Trimesh

        vertices, (start, end) = np.array(mesh.vertices), mesh.edges_unique.T
        start, end = np.concatenate([start, end]), np.concatenate([end, start])
        count = np.bincount(start, minlength=len(vertices))[:, None]
        for _ in range(self.steps):
            total = np.zeros_like(vertices)
            np.add.at(total, start, vertices[end])
            vertices = np.where(count > 0, total / np.maximum(count, 1), vertices)
        return Trimesh(vertices, mesh.faces, process=False)
