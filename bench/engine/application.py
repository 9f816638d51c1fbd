"""One method on one file: the worker's side and the runner's side of ``detailbench apply``.

The call is made in a child process like a benchmark cell, so a method that crashes, hangs or takes all memory gives
a message.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UsageError
from ..plan.choice import Choice
from ..plan.limits import Limits
from ..plan.training import Training
from .forkserver import CannotStart, ServerDied
from .isolate import Isolation

if TYPE_CHECKING:
    from .channel import Channel

UNORIENTED = 0.05  # share of contradicting normals above which the user is notified


@dataclass(frozen=True)
class Application:
    """A method, its inputs and its output."""

    task: Choice
    method: Choice
    inputs: tuple[str, ...]
    output: str
    seed: int = 0
    threads: int = 1
    device: str = "cpu"
    normals: str = "file"  # of an input cloud: "file": those of the file, if any; "estimate": as if it had none
    limit: Limits = field(default_factory=Limits)
    plugins: tuple[str, ...] = ()
    verbose: bool = False
    simplify: int = 0  # to at most this number of faces; 0: not simplified
    colors: bool = False  # whether the output takes the colours of the nearest points of the input
    training: Training | None = None  # the source of the weights of a learned method
    results: str = "results"  # where trained ones are searched


class Applier:
    """Applies one method to files, one after the other, each in a child of one fork server.

    The method's libraries are imported once. Inside ``with``, call it with an :class:`Application`; all share the
    method, the plugins and the threads of the first.
    """

    def __init__(self, first: Application):
        self._first = first
        self._isolation: Isolation | None = None

    def __enter__(self) -> Applier:
        return self

    def __exit__(self, *exception: object) -> None:
        self._end()

    def __call__(
        self, job: Application, on_event: Callable[[dict[str, Any]], None] = lambda event: None
    ) -> dict[str, Any]:
        """Run the application in a child process.

        Returns
        -------
        dict
            ``status`` and ``message`` like those of a row; with ``ok`` also ``seconds``, ``peak_rss_mb``, ``input`` and
            ``output`` (in words), ``stages`` (seconds by name), ``input_points``, ``output_points``, ``output_faces``,
            ``pieces``, where they apply, and ``notes``, the parts of the message.

        Raises
        ------
        UsageError
            If the method needs weights that do not exist, with the command that trains them.
        """
        arguments = _arguments(job)
        try:
            return self._call(job, arguments, on_event)
        except CannotStart:
            raise
        except ServerDied:  # by an earlier call: a new one is not affected
            self._end()
            return self._call(job, arguments, on_event)

    def _call(
        self, job: Application, arguments: Mapping[str, Any], on_event: Callable[[dict[str, Any]], None]
    ) -> dict[str, Any]:
        if self._isolation is None:
            first = self._first
            libraries = tuple(dict.fromkeys(library for plugin in first.method.parts for library in plugin.requires))
            self._isolation = Isolation(libraries, first.plugins, first.threads)
        return self._isolation.call(
            "bench.engine.application:call", arguments, limit=job.limit, on_event=on_event, verbose=job.verbose
        )

    def _end(self) -> None:
        if self._isolation is not None:
            self._isolation.close()
            self._isolation = None


def _arguments(job: Application) -> dict[str, Any]:
    """The job of the worker."""
    weights = _weights_of(job)
    return {
        "task": asdict(job.task),
        "method": asdict(job.method),
        "inputs": list(job.inputs),
        "output": job.output,
        "seed": job.seed,
        "device": job.device,
        "normals": job.normals,
        "simplify": job.simplify,
        "colors": job.colors,
        "weights": str(weights) if weights else "",
    }


def _weights_of(job: Application) -> Path | None:
    """The file of weights that a learned method needs; nothing is trained here."""
    if job.training is None:
        return None
    from ..results.store import Results
    from .training import known_weights

    if (known := known_weights(Results(job.results), job.training)) is None:
        name = job.training.method.name
        raise UsageError(
            f"method {name} is learned, and no shipped weights fit these parameters. Train it: detailbench train "
            f"method={name} dataset=NAME --save FILE; then add training.weights=FILE"
        )
    return known.path


def call(spec: Mapping[str, Any], channel: Channel) -> None:
    """The worker's side: read, call, validate, write."""
    from ..stages import listening
    from ..text import bounded
    from .channel import plain
    from .worker import failure

    clock = _StageClock(channel)
    notes: list[str] = []
    try:
        with listening(clock):
            row = _applied(spec, channel, notes)
        row |= {"status": "ok", "stages": clock.seconds}
    except BaseException as error:  # the boundary: shown as one message
        row = {"stage": channel.stage} | failure(error, channel.stage, notes)
    channel.send("result", row=plain(bounded(row)))


class _StageClock:
    """Passes the names of stages on, and adds up the seconds of each."""

    def __init__(self, channel: Channel):
        self.seconds: dict[str, float] = {}
        self._channel, self._current, self._since = channel, "", time.monotonic()

    def __call__(self, name: str) -> None:
        now = time.monotonic()
        if self._current:
            self.seconds[self._current] = self.seconds.get(self._current, 0.0) + now - self._since
        self._current, self._since = name, now
        self._channel.send("doing", what=name)


def _applied(spec: Mapping[str, Any], channel: Channel, notes: list[str]) -> dict[str, Any]:
    """The row of one call, whose output is written; its notices are added to ``notes``, also if it fails."""
    from ..geometry.io.files import check_target
    from ..notices import collected
    from ..plugins.weights import load
    from ..stages import stage
    from .call import MeasuredCall
    from .devices import check_device
    from .meter import Meter

    asked = spec["arguments"]
    channel.enter("prepare", 0)
    task, method = Choice(**asked["task"]), Choice(**asked["method"])
    check_device(asked["device"])
    solver = task.build()
    check_target(asked["output"], solver.output)  # nobody should wait for an output that cannot be written
    channel.enter("case", 0)
    with collected(notes), stage("reading"):
        inputs, frame = solver.read(asked["inputs"])
        inputs = {name: _with_normals_of(asked["normals"], value) for name, value in inputs.items()}
    call = MeasuredCall(
        task=task,
        method=method,
        solver=solver,
        inputs=inputs,
        seed=asked["seed"],
        spec=spec,
        meter=Meter(spec["memory_gb"], asked["device"]),
        channel=channel,
        weights=load(asked["weights"]) if asked.get("weights") else None,
    )
    try:
        with stage("solving"):
            output = call()
    finally:
        notes.extend(filter(None, [call.columns.get("message")]))
    channel.enter("write", 0)
    with collected(notes):
        restored = solver.restore(_with_attributes_of(inputs, output), frame)
        if asked["simplify"]:
            restored = _simplified(restored, asked)
        if asked["colors"]:
            restored = _colored(restored, [solver.restore(v, frame) for v in inputs.values() if _has_colors(v)])
        with stage("writing"):
            solver.save(restored, asked["output"], asked["inputs"])
    return call.columns | _sizes(inputs, restored) | {"message": "; ".join(notes), "notes": notes}


def _simplified(mesh: Any, asked: Mapping[str, Any]) -> Any:
    """The mesh with fewer faces, and a notice of the error that this causes."""
    from ..geometry.simplify import mesh_distance, simplify
    from ..notices import notice
    from ..seeds import generator
    from ..stages import stage

    with stage("simplifying"):
        fewer = simplify(mesh, asked["simplify"])
        if fewer is mesh:
            notice(f"not simplified: it has {len(mesh.faces):,} faces")
        else:
            distance = mesh_distance(mesh, fewer, generator(asked["seed"], "simplify"))
            notice(f"simplified from {len(mesh.faces):,} to {len(fewer.faces):,} faces, at a distance of {distance}")
    return fewer


def _has_colors(value: Any) -> bool:
    from ..geometry.cloud import PointCloud

    return isinstance(value, PointCloud) and value.colors is not None


def _colored(output: Any, clouds: Sequence[Any]) -> Any:
    """The output with the colours of the nearest points of the input, if that has any."""
    from ..geometry.nearest_colors import with_nearest_colors
    from ..notices import notice

    if not clouds:
        notice("no colours: the input has none")
        return output
    return with_nearest_colors(output, clouds[0])


def _sizes(inputs: Mapping[str, Any], output: Any) -> dict[str, Any]:
    """The inputs and the output in words and in numbers."""
    from .worker import sizes

    found: dict[str, Any] = {"input": _words(inputs.values()), "output": _words([output])} | sizes(output)
    for value in inputs.values():
        found.setdefault("input_points", sizes(value).get("output_points"))
    if hasattr(output, "faces"):
        from ..geometry.topology import pieces

        found["pieces"] = pieces(output.faces)
        if found["pieces"] > 1:
            found["output"] += f", {found['pieces']:,} pieces"
    return found


def _with_normals_of(source: str, value: Any) -> Any:
    """An input as it is given to a method: a cloud without its normals, or with a notice if they are not oriented."""
    from ..geometry.cloud import PointCloud
    from ..geometry.normals import disagreement
    from ..notices import notice

    if not isinstance(value, PointCloud) or value.normals is None:
        return value
    if source == "estimate":
        return replace(value, normals=None)
    share = disagreement(value.points, value.normals)
    if share > UNORIENTED:
        notice(
            f"{share:.0%} of the normals point opposite to their neighbours, as if they were not oriented; "
            "orient them, or add normals=estimate"
        )
    return value


def _with_attributes_of(inputs: Mapping[str, Any], output: Any) -> Any:
    """An output with the colours and scalars of the cloud that it was made from."""
    from ..geometry.attributes import carried
    from ..geometry.cloud import PointCloud

    source = inputs.get("cloud")
    makes_geometry = isinstance(output, PointCloud) or hasattr(output, "faces")
    return carried(source, output) if isinstance(source, PointCloud) and makes_geometry else output


def _words(values: Iterable[Any]) -> str:
    """Inputs or outputs in words: ``20,000 points with normals``; numbers and absent inputs are left out."""
    return "; ".join(filter(None, map(_in_words, values)))


def _in_words(value: Any) -> str:
    if hasattr(value, "faces"):
        return f"{len(value.vertices):,} vertices, {len(value.faces):,} faces"
    if hasattr(value, "points"):
        names = {"normals": value.normals, "colours": value.colors}
        extras = [*(name for name, array in names.items() if array is not None), *value.scalars]
        return f"{len(value.points):,} points{' with ' if extras else ''}{', '.join(extras)}"
    return repr(value) if hasattr(value, "arrays") else ""
