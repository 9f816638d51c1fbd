"""One method on one file: the worker's side and the runner's side of ``detailbench apply``.

The call is made in a child process like a benchmark cell, so a method that crashes, hangs or takes all memory ends in
a message.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UsageError
from ..plan.choice import Choice
from ..plan.limits import Limits
from ..plan.training import Training
from .isolate import Isolation

if TYPE_CHECKING:
    from .channel import Channel

UNORIENTED = 0.05  # share of contradicting normals above which the user is told


@dataclass(frozen=True)
class Application:
    """What to apply to what."""

    task: Choice
    method: Choice
    inputs: tuple[str, ...]
    output: str
    seed: int = 0
    threads: int = 1
    device: str = "cpu"
    normals: str = "file"  # of an input cloud: those of the file where it has any, or "estimate", as if it had none
    limit: Limits = field(default_factory=Limits)
    plugins: tuple[str, ...] = ()
    verbose: bool = False
    training: Training | None = None  # of a learned method: where its weights come from
    results: str = "results"  # where trained ones are looked for


def apply(job: Application, on_event: Callable[[dict[str, Any]], None] = lambda event: None) -> dict[str, Any]:
    """Run the application in a child process.

    Returns
    -------
    dict
        ``status`` and ``message`` like those of a row; with ``ok`` also ``seconds``, ``peak_rss_mb``, ``input`` and
        ``output`` (in words).

    Raises
    ------
    UsageError
        If the method needs weights that are not there, with the command that makes some.
    """
    weights = _weights_of(job)
    arguments = {
        "task": asdict(job.task),
        "method": asdict(job.method),
        "inputs": list(job.inputs),
        "output": job.output,
        "seed": job.seed,
        "device": job.device,
        "normals": job.normals,
        "weights": str(weights) if weights else "",
    }
    libraries = tuple(dict.fromkeys(library for plugin in job.method.parts for library in plugin.requires))
    with Isolation(libraries, job.plugins, job.threads) as isolation:
        return isolation.call(
            "bench.engine.application:call", arguments, limit=job.limit, on_event=on_event, verbose=job.verbose
        )


def _weights_of(job: Application) -> Path | None:
    """The file of weights that a learned method needs; nothing is trained here."""
    if job.training is None:
        return None
    from ..results.store import Results
    from .training import known_weights

    if (known := known_weights(Results(job.results), job.training)) is None:
        name = job.training.method.name
        raise UsageError(
            f"method {name} learns, and comes with no weights for these parameters. Train it: detailbench train "
            f"method={name} dataset=NAME --save FILE; then say training.weights=FILE"
        )
    return known.path


def call(spec: Mapping[str, Any], channel: Channel) -> None:
    """The worker's side: read, call, validate, write."""
    from ..geometry.io.files import check_target
    from ..notices import collected
    from ..plugins.weights import load
    from ..text import bounded
    from .call import MeasuredCall
    from .channel import plain
    from .devices import check_device
    from .meter import Meter
    from .worker import failure

    asked = spec["arguments"]
    try:
        channel.enter("prepare", 0)
        task, method = Choice(**asked["task"]), Choice(**asked["method"])
        check_device(asked["device"])
        solver = task.build()
        check_target(asked["output"], solver.output)  # nobody should wait for what cannot be written
        channel.enter("case", 0)
        with collected() as notices:
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
        output = call()
        channel.enter("write", 0)
        with collected() as written:
            restored = solver.restore(_with_attributes_of(inputs, output), frame)
            solver.save(restored, asked["output"], asked["inputs"])
            row = call.columns | {"output": _words([restored])}
        row["message"] = "; ".join(filter(None, [*notices, row["message"], *written]))
        row |= {"status": "ok", "input": _words(inputs.values())}
    except BaseException as error:  # the boundary: shown as one message
        row = {"stage": channel.stage} | failure(error, channel.stage)
    channel.send("result", row=plain(bounded(row)))


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
            f"{share:.0%} of the normals point the other way than those around them, as if they were not oriented; "
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
    """Inputs or outputs in words: ``20,000 points with normals``; numbers and what is not given are left out."""
    return "; ".join(filter(None, map(_in_words, values)))


def _in_words(value: Any) -> str:
    if hasattr(value, "faces"):
        return f"{len(value.vertices):,} vertices, {len(value.faces):,} faces"
    if hasattr(value, "points"):
        names = {"normals": value.normals, "colours": value.colors}
        extras = [*(name for name, array in names.items() if array is not None), *value.scalars]
        return f"{len(value.points):,} points{' with ' if extras else ''}{', '.join(extras)}"
    return repr(value) if hasattr(value, "arrays") else ""
