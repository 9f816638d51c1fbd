"""Tasks: what a method is given, what it returns, and how a case is made from shapes.

A task is a plugin like any other. Its name is the name of the function that a method must have; the keys of
``Case.input`` are that function's arguments, so the engine knows nothing of clouds, meshes or cages::

    output = getattr(method, task_name)(**case.input, run=run)

A task over images says ``takes = "views"`` and goes with the sensors that give them. A task over pairs (deform) says
``takes = "none"``, overrides :meth:`Task.recipes` and asks its dataset for ``pairs`` instead of ``shapes``; with a
function ``toy()`` that returns a small :class:`bench.Case`, the conformance kit can try methods of such a task too.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from ..errors import InvalidOutput, UsageError
from ..geometry.cloud import Frame, PointCloud
from ..seeds import generator
from .case import Case
from .shape import Shape

if TYPE_CHECKING:
    from trimesh import Trimesh

    from .run import Run
    from .views import Views


class CaseRecipe(NamedTuple):
    """A lazy case: its id is known before it is made."""

    id: str
    build: Callable[[], Case]


class Task:
    """Base of tasks whose cases are made from one shape and one sensor."""

    takes: ClassVar[str] = "cloud"  # what its sensor must give: "cloud", "views", a custom name, or "none"
    needs_sensor: ClassVar[bool] = True  # False is the same as takes = "none"
    output: ClassVar[str] = "cloud"  # what a method returns: "cloud" or "mesh"; metrics choose by it
    promise: ClassVar[str] = "a PointCloud"  # in words, for messages
    files: ClassVar[tuple[int, ...]] = (1,)  # how many input files `read` takes
    # The scores that rank this task's tables where the user names none: one gives a rank, two give a Pareto front
    # instead. Without any, the first in the usual order of the metrics ranks.
    primary: ClassVar[tuple[str, ...]] = ()

    def recipes(self, dataset: Any, sensor: Any, *, split: str, count: int, seed: int) -> Iterator[CaseRecipe]:
        """The first ``count`` cases of a dataset's split.

        The sensor's noise and the metrics' samples depend on (seed, shape) alone, so all methods get the same input.
        """
        if not hasattr(dataset, "shapes"):
            raise UsageError(f"task {type(self).__name__}: the dataset {type(dataset).__name__} has no shapes(split)")
        for shape in islice(dataset.shapes(split), count):
            yield CaseRecipe(shape.id, partial(self._case, shape, sensor, seed))

    def _case(self, shape: Shape, sensor: Any, seed: int) -> Case:
        framed, frame = shape.framed()
        sensed = sensor.sense(framed, generator(seed, shape.id, "sensor"))
        return Case(shape.id, self.input(sensed), framed, frame, seed, shape.tags)

    def input(self, sensed: Any) -> dict[str, Any]:
        """The arguments of the method's function, made from the sensor's output: ``{takes: sensed}``."""
        return {self.takes: sensed}

    def describe(self, case: Case) -> dict[str, float]:
        """What is measured of a case's input, off the clock: see :func:`bench.geometry.conditions.describe_cloud`."""
        from ..geometry.conditions import describe_cloud

        cloud = case.input.get("cloud")
        if not isinstance(cloud, PointCloud) or not len(cloud) or not np.isfinite(cloud.points).all():
            return {}
        if case.reference.cloud is not None:  # the distance to an unknown surface is unknown
            return {"points": float(len(cloud)), "reference_points": float(len(case.reference.cloud))}
        name = f"state of {hashlib.sha256(cloud.points.tobytes()).hexdigest()}"
        known = case.remember(name, lambda: {k: np.asarray(v) for k, v in describe_cloud(cloud, case).items()})
        return {key: float(value) for key, value in known.items()}

    def describe_words(self, medians: Mapping[str, float]) -> str:
        """What :meth:`describe` measured, in a sentence for the notes of a leaderboard.

        Parameters
        ----------
        medians : mapping
            The median over the cases of each known value; results of older versions may lack some.

        Returns
        -------
        str
            Empty if there is nothing to report.
        """
        if "reference_points" in medians:
            return (
                f"input, median of the cases: {medians['points']:,.0f} points; references are clouds of "
                f"{medians['reference_points']:,.0f} points."
            )
        if "rms" not in medians:
            return generic_words(medians)
        varies = medians.get("density_variation", math.nan)
        return (
            f"input, median of the cases: {medians['points']:,.0f} points; RMS error {medians['rms_inliers']:.2g}; "
            f"outliers (> 0.05) {medians['outliers']:.1%}"
            + (
                f"; coverage {medians['coverage']:.1%}; density varies by {varies:.0%}."
                if "coverage" in medians
                else "."
            )
        )

    def expected(self, input: Mapping[str, Any]) -> int:
        """Approximate number of points or vertices of an output: as many as the first cloud or mesh of the input."""
        from ..geometry.used import used_vertices

        for value in input.values():
            if hasattr(value, "points"):
                return len(value.points)
            if hasattr(value, "faces") and hasattr(value, "vertices"):
                return len(used_vertices(value))
            if hasattr(value, "vertices"):
                return len(value.vertices)
        return 1000

    def hopeless(self, case: Case) -> tuple[Any, ...]:
        """Uninformed outputs for a case: random points (or tiny triangles), as many as expected; and an empty output.

        The worse of their scores is imputed to a failed case: see :mod:`imputation`. A task whose outputs are
        neither clouds nor meshes has none.
        """
        from ..geometry.hopeless import no_faces, no_points, random_cloud, random_triangles

        count, rng = self.expected(case.input), generator(case.seed, case.id, "hopeless")
        if self.output == "cloud":
            return random_cloud(count, rng), no_points()
        return (random_triangles(count, rng), no_faces()) if self.output == "mesh" else ()

    def read(self, paths: Sequence[str]) -> tuple[dict[str, Any], Frame]:
        """The arguments of the method's function from the user's files, and the frame that they were scaled to.

        Raises
        ------
        BadInput
            Naming the file and what was expected of it.
        """
        from ..geometry.check import check_points
        from ..geometry.io.files import load_cloud
        from ..geometry.stray import frame_of_bulk

        if self.takes != "cloud":
            name = type(self).__name__
            raise UsageError(f"task {name}: cannot be applied to files, because it has no read(paths) for {self.takes}")
        if len(paths) != 1:
            raise UsageError(f"expected one input file, got {len(paths)}: {', '.join(paths) or 'none'}")
        cloud = load_cloud(paths[0])
        check_points(cloud.points, str(paths[0]), at_least=3)
        frame = frame_of_bulk(cloud.points)
        return self.input(cloud.moved(frame.apply(cloud.points))), frame

    def restore(self, output: Any, frame: Frame) -> Any:
        """An output in the coordinates of the user's file."""
        if isinstance(output, PointCloud):
            return output.moved(frame.invert(output.points))
        output = output.copy()
        output.vertices = frame.invert(output.vertices)
        return output

    def save(self, output: Any, path: str, inputs: Sequence[str]) -> None:
        """Write an output to a file, in the coordinates of the user's ``inputs``, whose paths a task may use."""
        from ..geometry.io.files import save

        save(output, path)

    def solve(self, method: Any, name: str, input: dict[str, Any], run: Run) -> Any:
        """Call the method's function of this task."""
        return getattr(method, name)(**input, run=run)

    def validate(self, output: Any, input: dict[str, Any]) -> None:
        """Check an output against the promise.

        Raises
        ------
        InvalidOutput
            Stating what was promised and what was returned.
        """
        raise InvalidOutput(f"task {type(self).__name__} has no function validate(output, input)")


def validate_deformed(output: Any, source: Trimesh, promise: str) -> None:
    """Check that a mesh is its source with other vertices, as promised.

    Raises
    ------
    InvalidOutput
        If it is not a mesh, or has other faces or another number of vertices.
    """
    validate_mesh(output, promise)
    if len(output.vertices) != len(source.vertices) or not np.array_equal(output.faces, source.faces):
        raise InvalidOutput(
            f"promised {promise}; got {len(output.vertices)} vertices and {len(output.faces)} faces that are "
            f"not the {len(source.vertices)} and {len(source.faces)} of the source"
        )


def describe_target(target: Any) -> dict[str, float]:
    """The number of given points or vertices of a target, for :meth:`Task.describe`."""
    if isinstance(target, PointCloud):
        return {"target_points": float(len(target))}
    return {"target_vertices": float(len(target.vertices))}


def target_words(medians: Mapping[str, float]) -> str:
    """The given part of the targets, as the end of a list."""
    if "target_points" in medians:
        return f"; targets are clouds of {medians['target_points']:,.0f} points"
    if "target_vertices" in medians:
        return f"; targets are meshes of {medians['target_vertices']:,.0f} vertices"
    return ""


def describe_views(views: Views) -> dict[str, float]:
    """How many views there are, how many pixels across, and how much of them the shape covers."""
    return {"views": len(views), "pixels": float(views.width), "covered": float(views.masks.mean())}


def views_words(medians: Mapping[str, float]) -> str:
    """What :func:`describe_views` measured, in a sentence."""
    if not {"views", "pixels", "covered"} <= set(medians):
        return ""
    return (
        f"input, median of the cases: {medians['views']:.0f} images of {medians['pixels']:.0f} pixels across, "
        f"{medians['covered']:.0%} covered."
    )


def generic_words(medians: Mapping[str, float]) -> str:
    """The sentence on the inputs of a task without its own: ``input, median ...: views=24.``"""
    values = ", ".join(f"{key}={value:.4g}" for key, value in medians.items())
    return f"input, median of the cases: {values}." if values else ""


def validate_cloud(output: Any, promise: str) -> None:
    """Raise :class:`InvalidOutput` unless ``output`` is a non-empty, finite :class:`PointCloud`."""
    if not isinstance(output, PointCloud):
        raise InvalidOutput(f"promised {promise}; got {_kind(output)}")
    if not len(output):
        raise InvalidOutput(f"promised {promise}; got no points")
    bad = int((~np.isfinite(output.points)).any(axis=1).sum())
    if bad:
        raise InvalidOutput(f"promised {promise}; {bad} of {len(output)} points are NaN or infinite")
    if output.normals is not None:
        lengths = np.linalg.norm(output.normals, axis=1)
        bad = int((~(np.abs(lengths - 1) < 1e-3)).sum())
        if bad:
            raise InvalidOutput(f"promised {promise}; {bad} of {len(output)} normals are not of unit length")


def validate_mesh(output: Any, promise: str) -> None:
    """Raise :class:`InvalidOutput` unless ``output`` is a ``Trimesh`` with faces and finite vertices."""
    from trimesh import Trimesh

    if not isinstance(output, Trimesh):
        raise InvalidOutput(f"promised {promise}; got {_kind(output)}")
    if not len(output.faces):
        raise InvalidOutput(f"promised {promise}; got a mesh of {len(output.vertices)} vertices without faces")
    if output.faces.min() < 0 or output.faces.max() >= len(output.vertices):
        raise InvalidOutput(f"promised {promise}; faces name vertices that do not exist")
    bad = int((~np.isfinite(output.vertices)).any(axis=1).sum())
    if bad:
        raise InvalidOutput(f"promised {promise}; {bad} of {len(output.vertices)} vertices are NaN or infinite")
    if not output.area > 0:
        raise InvalidOutput(f"promised {promise}; none of its {len(output.faces)} faces has an area")


def _kind(value: Any) -> str:
    name = f"{type(value).__module__}.{type(value).__qualname__}".removeprefix("builtins.")
    return f"{name} of shape {value.shape}" if hasattr(value, "shape") else name
