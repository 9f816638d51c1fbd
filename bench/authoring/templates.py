"""What ``detailbench new`` writes. NAME and CLASS are replaced."""

METHOD = '''"""CLASS: say in a line what the method does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import BadInput, PointCloud, Run, register


@register("method", cite="Whom to cite, and the year", requires=("scipy",))
@dataclass(frozen=True)
class CLASS:
    """Move every point to the mean of its neighbours (replace this by your method)."""

    neighbours: int = 16  # how many nearest points the mean is taken over
    steps: int = 1  # how often

    # A member function named after a task says that the method solves it: reconstruct(self, cloud, run) -> Trimesh,
    # denoise(self, cloud, run) -> PointCloud, upsample(self, cloud, ratio, run) -> PointCloud.
    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        from scipy.spatial import cKDTree  # heavy libraries are imported where they are used

        if len(cloud) < 2 or not np.isfinite(cloud.points).all():
            raise BadInput(f"NAME: expected at least 2 finite points, got {len(cloud)}")
        points = cloud.points
        for step in range(self.steps):
            neighbours = min(self.neighbours, len(points))
            _, nearest = cKDTree(points).query(points, k=neighbours, workers=run.threads)
            points = points[nearest].mean(axis=1)
            run.progress(step + 1, self.steps)
        return PointCloud(points, cloud.normals)
'''

DATASET = '''"""CLASS: say in a line what the shapes are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count

from bench import Shape, generator, register


@register("dataset")
@dataclass(frozen=True)
class CLASS:
    """Balls with one bump each (replace this by your shapes)."""

    height: float = 0.3  # of the bump, relative to the ball's radius

    def shapes(self, split: str) -> Iterator[Shape]:
        # The engine takes as many as it wants. A shape depends on its split and index alone: train and test never meet.
        for index in count():
            yield Shape(
                id=f"NAME-{split}-{index:03d}",
                mesh=lambda index=index: self._mesh(split, index),  # made when it is needed
                tags=("smooth",),
            )

    def _mesh(self, split: str, index: int):
        import numpy as np
        from trimesh.creation import icosphere

        rng = generator("NAME", split, index)
        mesh = icosphere(subdivisions=5)
        towards = rng.normal(size=3)
        towards /= np.linalg.norm(towards)
        mesh.vertices *= 1 + self.height * np.exp(-8 * (1 - mesh.vertices @ towards))[:, None]
        return mesh
'''

SENSOR = '''"""CLASS: say in a line what the sensor does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Shape, register


@register("sensor")
@dataclass(frozen=True)
class CLASS:
    """Uniform samples with Gaussian noise along the normal (replace this by your sensor)."""

    count: int = 5000  # how many points
    noise: float = 0.005  # standard deviation, relative to the radius of the bounding sphere

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud:
        # The shape is in the frame of the case: its box centre at the origin, its farthest vertex at radius 1.
        points, normals = shape.surface.sample(self.count, rng)
        return PointCloud(points + self.noise * rng.normal(size=(self.count, 1)) * normals, normals)
'''

METRIC = '''"""CLASS: say in a line what is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Case, register


@register("metric", version=1, better="lower", outputs=("mesh", "cloud"))
@dataclass(frozen=True)
class CLASS:
    """Median distance of the output to the reference's surface (replace this by your formula)."""

    # Raise the version whenever the numbers change: results of the old one are then run again.
    def score(self, output, case: Case) -> dict[str, float]:
        # case.compare(output) holds the directed distances, computed once and shared by all metrics.
        return {"NAME": float(np.median(case.compare(output).to_surface.distance))}
'''

TASK = '''"""CLASS: say in a line what is asked for, and what a method starts from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, ClassVar

import numpy as np

from bench import Case, CaseRecipe, Frame, InvalidOutput, Run, Shape, Task, generator, register, validate_mesh


@register("task")
@dataclass(frozen=True)
class CLASS(Task):
    """A mesh with noisy vertices -> the same mesh without the noise (replace this by your task)."""

    takes: ClassVar[str] = "none"  # what the sensor gives: "cloud", "views", or "none": no sensor takes part
    output: ClassVar[str] = "mesh"  # what a method returns, "mesh" or "cloud": metrics choose by it
    promise: ClassVar[str] = "a trimesh.Trimesh with the faces of the input, in their order, and finite vertices"
    files: ClassVar[tuple[int, ...]] = (1,)  # how many input files `detailbench apply` may be given

    noise: float = 0.01  # standard deviation of each coordinate, relative to the radius

    # With takes = "cloud" or "views" leave recipes() out: the cases are made by the sensor, see bench.Task.
    def recipes(self, dataset: Any, sensor: Any, *, split: str, count: int, seed: int) -> Iterator[CaseRecipe]:
        for shape in islice(dataset.shapes(split), count):
            yield CaseRecipe(shape.id, lambda shape=shape: self._noisy_case(shape, seed))  # made when it is needed

    def _noisy_case(self, shape: Shape, seed: int) -> Case:
        reference, frame = shape.framed()  # box centre at the origin, farthest vertex at radius 1
        mesh = reference.mesh.copy()
        # Draw from the seed and the shape alone, so that all methods are given the same input.
        mesh.vertices += generator(seed, shape.id, "noise").normal(scale=self.noise, size=mesh.vertices.shape)
        # The keys are the arguments of the method's function: NAME(self, mesh, run).
        return Case(shape.id, {"mesh": mesh}, reference, frame, seed, shape.tags)

    def validate(self, output: Any, input: dict[str, Any]) -> None:
        validate_mesh(output, self.promise)
        if not np.array_equal(output.faces, input["mesh"].faces):
            raise InvalidOutput(f"promised {self.promise}; got other faces")

    def describe(self, case: Case) -> dict[str, float]:
        # Measured of every input, stored as input.noise_rms, and told below the leaderboard.
        moved = case.input["mesh"].vertices - case.reference.mesh.vertices
        return {"noise_rms": float(np.sqrt((moved**2).sum(axis=1).mean()))}

    def describe_words(self, medians: Mapping[str, float]) -> str:
        return f"input, median of the cases: vertices moved by {medians['noise_rms']:.2g} (RMS)."

    def read(self, paths: Sequence[str]) -> tuple[dict[str, Any], Frame]:
        # For `detailbench apply`: the arguments from the user's files, and the frame that they were scaled to.
        from bench.geometry.io.files import load_mesh

        mesh = load_mesh(paths[0])
        frame = Frame.of(mesh.vertices)
        mesh.vertices = frame.apply(mesh.vertices)
        return {"mesh": mesh}, frame

    def toy(self) -> Case:
        # A small case, with which `detailbench check` tries the methods of this task.
        from trimesh.creation import icosphere

        return self._noisy_case(Shape("toy", icosphere(subdivisions=3)), seed=0)


@register("method")
@dataclass(frozen=True)
class CLASSBaseline:
    """Every vertex at the mean of its neighbours: a simple method to compare others with."""

    steps: int = 1  # how often

    def NAME(self, mesh, run: Run):
        from trimesh import Trimesh

        vertices, (start, end) = np.array(mesh.vertices), mesh.edges_unique.T
        start, end = np.concatenate([start, end]), np.concatenate([end, start])
        count = np.bincount(start, minlength=len(vertices))[:, None]
        for _ in range(self.steps):
            total = np.zeros_like(vertices)
            np.add.at(total, start, vertices[end])
            vertices = np.where(count > 0, total / np.maximum(count, 1), vertices)
        return Trimesh(vertices, mesh.faces, process=False)
'''

TEST = '''"""The contract, and what only this plugin promises."""

from pathlib import Path

from bench.testing import assert_conforms


def test_it_keeps_the_contract():
    assert_conforms(Path(__file__).with_name("NAME.py"))
'''

TEMPLATES = {"method": METHOD, "dataset": DATASET, "sensor": SENSOR, "metric": METRIC, "task": TASK}
HINTS = {
    "method": "task=denoise method=NAME dataset=bumps",
    "dataset": "dataset=NAME method=poisson",
    "sensor": "sensor=NAME method=poisson",
    "metric": "metric=[standard,NAME] method=poisson",
    "task": "task=NAME method=NAME_baseline dataset=bumps",
}
