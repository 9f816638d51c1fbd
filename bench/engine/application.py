"""One method on one file: the worker's side and the runner's side of ``detailbench apply``.

The call is made in a child process like a benchmark cell, so a method that crashes, hangs or takes all memory ends in
a message.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from ..plan.cell import Choice
from ..plan.limits import Limits
from .isolate import Isolation

if TYPE_CHECKING:
    from .channel import Channel


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
    limit: Limits = field(default_factory=Limits)
    plugins: tuple[str, ...] = ()
    verbose: bool = False


def apply(job: Application, on_event: Callable[[dict[str, Any]], None] = lambda event: None) -> dict[str, Any]:
    """Run the application in a child process.

    Returns
    -------
    dict
        ``status`` and ``message`` like those of a row; with ``ok`` also ``seconds``, ``peak_rss_mb``, ``input`` and
        ``output`` (in words).
    """
    arguments = {
        "task": asdict(job.task),
        "method": asdict(job.method),
        "inputs": list(job.inputs),
        "output": job.output,
        "seed": job.seed,
        "device": job.device,
    }
    with Isolation(job.method.plugin.requires, job.plugins, job.threads) as isolation:
        return isolation.call(
            "bench.engine.application:call", arguments, limit=job.limit, on_event=on_event, verbose=job.verbose
        )


def call(spec: Mapping[str, Any], channel: Channel) -> None:
    """The worker's side: read, call, validate, write."""
    from ..geometry.io.files import check_target
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
        inputs, frame = solver.read(asked["inputs"])
        call = MeasuredCall(
            task=task,
            method=method,
            solver=solver,
            inputs=inputs,
            seed=asked["seed"],
            spec=spec,
            meter=Meter(spec["memory_gb"], asked["device"]),
            channel=channel,
        )
        output = call()
        channel.enter("write", 0)
        row = call.columns | _write(solver.restore(output, frame), asked["output"])
        row |= {"status": "ok", "input": _words(inputs.values())}
    except BaseException as error:  # the boundary: shown as one message
        row = {"stage": channel.stage} | failure(error, channel.stage)
    channel.send("result", row=plain(row))


def _write(output: Any, path: str) -> dict[str, Any]:
    from ..geometry.io.files import save

    save(output, path)
    return {"output": _words([output])}


def _words(values: Iterable[Any]) -> str:
    """Inputs or outputs in words: ``20,000 points with normals``; numbers and what is not given are left out."""
    return "; ".join(filter(None, map(_in_words, values)))


def _in_words(value: Any) -> str:
    if hasattr(value, "faces"):
        return f"{len(value.vertices):,} vertices, {len(value.faces):,} faces"
    if hasattr(value, "points"):
        return f"{len(value.points):,} points{' with normals' if value.normals is not None else ''}"
    return repr(value) if hasattr(value, "arrays") else ""
