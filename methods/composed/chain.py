"""A chain of methods: denoisers one after the other, a method that solves the task, and a reduction of its mesh."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench import InvalidOutput, PointCloud, Run, build_parts, generator, register, validate_cloud, validate_mesh
from bench.geometry.farthest import farthest_points, load_compiled

if TYPE_CHECKING:
    from trimesh import Trimesh

    from bench import Plugin

EXAMPLE = "[{wlop: {radius: 3.0}}, poisson]"
FEWEST = 4  # faces of a mesh that encloses a volume
FINE = 1000  # parts of a step's progress


class _AsTheLastStep:
    """A function that a chain has only if its last step has it; the class always has it."""

    def __init__(self, function: Callable[..., Any]):
        self._function, self.__doc__ = function, function.__doc__

    def __get__(self, chain: Chain | None, owner: type) -> Callable[..., Any]:
        if chain is None:
            return self._function
        chain.expect(self._function.__name__)
        return partial(self._function, chain)


@register("method", requires=("numba", "open3d"))
@dataclass(frozen=True)
class Chain:
    """Methods one after the other: all but the last denoise the cloud, the last solves the task.

    Any denoiser goes before any method that takes a cloud: ``steps=[{wlop: {radius: 3.0}}, poisson]``. A chain solves
    those of ``denoise``, ``upsample`` and ``reconstruct`` that its last step solves.

    With ``faces`` the mesh of the last step is reduced to that number of faces by quadric error metrics (Garland and
    Heckbert 1997): ``steps=[radius_outlier, jet, poisson] faces=20000``. A note reports the distance between the
    reduced mesh and the original, in the unit of the frame, in which the input has radius 1. Such a chain solves only
    ``reconstruct``.

    A denoiser may change the number of points. ``upsample`` still returns ``ratio * N`` points for an input of N: the
    last step is called with the smallest ratio that suffices for the points that it receives, and the surplus is
    removed by farthest point sampling. A last step that does not support every ratio declares those it supports in an
    attribute ``ratios`` (integers), and the chain uses the smallest sufficient one.

    Every step has its own random generator, independent of what the steps before it drew, and the remaining time. Its
    notes begin with its name, its stored artifacts with its number, and the parameters of learned steps are summed.
    Traces are those of the last step. One step may be learned; the weights are its own. The clouds between the steps
    are stored as ``1-NAME``, ``2-NAME``, ... beside the outputs.
    """

    # methods: names, or {name: {parameter: value}}
    steps: tuple[Any, ...] = ("statistical_outlier", "identity")
    faces: int = 0  # reduce the mesh of the last step to at most this many faces, 4 or more; 0 keeps all

    def __post_init__(self) -> None:
        if isinstance(self.steps, str):
            raise ValueError(f"steps: expected a list, got {self.steps!r}; write [{self.steps}]")
        if not self.steps:
            raise ValueError(f"steps: expected at least one, for instance {EXAMPLE}")
        for number, (plugin, _) in enumerate(self._parts[:-1], 1):  # mistakes are refused here, not in the first case
            if not plugin.solves("denoise"):
                raise ValueError(
                    f"steps: number {number}, {plugin.name}, does not solve denoise; every step but the last must be a "
                    f"denoiser: {EXAMPLE}"
                )
        if self.faces and self.faces < FEWEST:
            raise ValueError(f"faces: expected 0, which keeps all, or at least {FEWEST}, got {self.faces}")
        if self.faces and not self._parts[-1].plugin.solves("reconstruct"):
            raise ValueError(f"faces: the last step, {self._parts[-1].plugin.name}, gives no mesh to reduce")

    @cached_property
    def _parts(self) -> tuple[Any, ...]:
        return build_parts("method", self.steps, "steps")

    # -- the interface to the engine -------------------------------------------------------------------------------

    @property
    def plugins(self) -> tuple[Plugin, ...]:
        """The plugins of the steps, and the plugins that these are composed of."""
        return tuple(plugin for part in self._parts for plugin in part.plugins)

    @property
    def steps_chosen(self) -> tuple[tuple[str, dict[str, Any]], ...]:
        """The name and all parameters of each step; a nested chain is replaced by its steps."""
        chosen: list[tuple[str, dict[str, Any]]] = []
        for plugin, method in self._parts:
            values = {f.name: getattr(method, f.name) for f in dataclasses.fields(method)}
            chosen += getattr(method, "steps_chosen", ((plugin.name, values),))
        return tuple(chosen)

    def prepare(self) -> None:
        """Import the libraries of the steps, and prepare each step; not part of the measured call."""
        load_compiled()
        for number, (plugin, method) in enumerate(self._parts, 1):
            with self._named(number):
                plugin.require()
                getattr(method, "prepare", lambda: None)()

    def reads(self) -> Iterator[Path]:
        """The files that the steps read."""
        for _, method in self._parts:
            written = getattr(method, "writes", ("save",))
            own = () if isinstance(method, Chain) else dataclasses.fields(method)  # a nested chain lists its own files
            for f in own:
                if f.name not in written:
                    yield from _files(getattr(method, f.name))
            yield from getattr(method, "reads", tuple)()

    def expect(self, task: str) -> None:
        """Raise :class:`AttributeError`, naming the last step, unless it solves the task with its parameters."""
        plugin, method = self._parts[-1]
        if not callable(getattr(method, task, None)):
            raise AttributeError(f"chain: its last step, {plugin.name}, does not solve {task}")
        if self.faces and task != "reconstruct":
            raise AttributeError(f"chain: with faces={self.faces} it gives a mesh, and does not solve {task}")

    # -- the tasks -------------------------------------------------------------------------------------------------

    @_AsTheLastStep
    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """The cloud through all steps."""
        return self._solve("denoise", cloud, run)

    @_AsTheLastStep
    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """The last step's mesh of the denoised cloud, reduced to ``faces``."""
        mesh = self._last("reconstruct", run, self._reduced, cloud=self._denoised(cloud, run))
        fewer = self._reduced(mesh)
        if fewer is not mesh:
            from bench.geometry.simplify import mesh_distance

            distance = mesh_distance(mesh, fewer, run.rng)
            run.note(f"reduced from {len(mesh.faces):,} to {len(fewer.faces):,} faces, at a distance of {distance}")
        return fewer

    @_AsTheLastStep
    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """Exactly ``ratio * len(cloud)`` points, even if the steps before the last change their number."""
        wanted = ratio * len(cloud)
        denoised = self._denoised(cloud, run)
        least = -(-wanted // max(len(denoised), 1))  # the input of a chain of one step may be empty
        offered = getattr(self._parts[-1].made, "ratios", None)
        enough = [r for r in offered if r >= least] if offered is not None else [least]
        if not enough:
            assert offered is not None  # otherwise ``least`` is enough
            raise InvalidOutput(
                f"{self._name(len(self._parts))}: got {len(denoised)} of {len(cloud)} points, and must return "
                f"{ratio} x {len(cloud)}: this needs a ratio of {least}, but it supports {sorted(offered)}"
            )
        asked = min(enough)

        def thinned(output: PointCloud) -> PointCloud:
            validate_cloud(output, self._promise(len(self._parts)))
            if len(output) <= wanted:  # as promised, or too few: the task reports that
                return output
            return output.subset(farthest_points(output.points, wanted))

        return thinned(self._last("upsample", run, thinned, cloud=denoised, ratio=asked))

    def _reduced(self, mesh: Trimesh) -> Trimesh:
        """A mesh of the last step, with at most the requested number of faces."""
        if not self.faces:
            return mesh
        from bench.geometry.simplify import simplify

        validate_mesh(mesh, f"a mesh from {self._name(len(self._parts))}")
        return simplify(mesh, self.faces)

    def _solve(self, task: str, cloud: PointCloud, run: Run) -> Any:
        return self._last(task, run, lambda output: output, cloud=self._denoised(cloud, run))

    # -- the steps -------------------------------------------------------------------------------------------------

    def _denoised(self, cloud: PointCloud, run: Run) -> PointCloud:
        """The cloud after all steps but the last."""
        for number, (plugin, method) in enumerate(self._parts[:-1], 1):
            with self._step(number, run) as own:
                cloud = method.denoise(cloud, run=own)
            validate_cloud(cloud, self._promise(number))
            run.keep(f"{number}-{plugin.name}"[:64], cloud)
        return cloud

    def _last(self, task: str, run: Run, finished: Callable[[Any], Any], **inputs: Any) -> Any:
        """The output of the last step; its traces pass through ``finished``."""

        def traced(output: Any, seconds: float, keep: bool = False) -> None:
            run.trace(lambda: finished(output() if callable(output) else output), keep)

        with self._step(len(self._parts), run) as own:
            own.on_trace = traced if run.on_trace else None
            return getattr(self._parts[-1].made, task)(**inputs, run=own)

    @contextlib.contextmanager
    def _step(self, number: int, run: Run) -> Iterator[Run]:
        """The run of a step; it reports to the run of the chain."""
        plugin, method = self._parts[number - 1]

        def progress(done: int, total: int) -> None:
            run.progress(FINE * (number - 1) + FINE * done // max(total, 1), FINE * len(self._parts))

        own = Run(
            seed=int(generator(run.seed, "chain", number).integers(2**32)),
            device=run.device,
            threads=run.threads,
            seconds=max(run.seconds_left(), 0.0),
            weights=run.weights if hasattr(method, "fit") or isinstance(method, Chain) else None,
            on_progress=progress,
            on_keep=lambda name, value: run.keep(f"{number}-{name}"[:64], value),
            on_distances=run.true_distances if run.has_truth else None,
        )
        if run.on_keep is None:
            own.on_keep = None
        try:
            with self._named(number):
                yield own
        finally:
            for text in own.notes:
                run.note(text if text.startswith(plugin.name) else f"{plugin.name}: {text}")
            _add_parameters(run, own)
        progress(1, 1)

    @contextlib.contextmanager
    def _named(self, number: int) -> Iterator[None]:
        """Add the name of the step to every exception."""
        try:
            yield
        except Exception as error:
            error.add_note(f"in {self._name(number)}")
            raise

    def _name(self, number: int) -> str:
        return f"step {number} of the chain, {self._parts[number - 1].plugin.name}"

    def _promise(self, number: int) -> str:
        return f"a PointCloud of finite points from {self._name(number)}"


def _add_parameters(run: Run, own: Run) -> None:
    """Add the parameters of a step to those of the chain."""
    if own.active_parameters is not None or run.active_parameters is not None:
        counts = [r.parameters if r.active_parameters is None else r.active_parameters for r in (run, own)]
        run.active_parameters = sum(count or 0 for count in counts)
    if own.parameters is not None:
        run.parameters = (run.parameters or 0) + own.parameters


def _files(value: Any) -> Iterator[Path]:
    """The existing files that a parameter names."""
    if isinstance(value, (list, tuple, dict)):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _files(inner)
    elif isinstance(value, (str, Path)) and value and "\0" not in str(value) and Path(value).expanduser().is_file():
        yield Path(value).expanduser()
