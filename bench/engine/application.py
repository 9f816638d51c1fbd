"""One method on one file: the worker's side and the runner's side of ``detailbench apply``.

The call is made in a child process like a benchmark cell, so a method that crashes, hangs or takes all memory ends in
a message.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from ..plan.cell import Choice
from ..plan.limits import Limits
from .isolate import Isolation

if TYPE_CHECKING:
    from .worker import Channel


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
    from .devices import check_device, make_context
    from .meter import Meter
    from .worker import failure, plain, prepare

    call = spec["arguments"]
    try:
        channel.enter("prepare", 0)
        task, method = Choice(**call["task"]), Choice(**call["method"])
        method.plugin.require()
        check_device(call["device"])
        solver, promised = method.build(), task.build()
        check_target(call["output"], promised.output)  # nobody should wait for what cannot be written
        channel.enter("case", 0)
        inputs, frame = promised.read(call["inputs"])
        meter = Meter(spec["memory_gb"], call["device"])
        channel.enter("prepare", 0)
        make_context(call["device"])
        prepare(solver)
        run = _run(spec, channel)
        channel.enter("method", 0)
        with meter:
            run._started = time.perf_counter()
            output = promised.solve(solver, task.name, dict(inputs), run)
        promised.validate(output, inputs)
        channel.enter("write", 0)
        row = meter.figures() | _write(promised.restore(output, frame), call["output"])
        row |= {"status": "ok", "message": "; ".join(run.notes), "input": _words(inputs.values())}
    except BaseException as error:  # the boundary: shown as one message
        row = {"stage": channel.stage} | failure(error, channel.stage)
    channel.send("result", row=plain(row))


def _run(spec: Mapping[str, Any], channel: Channel) -> Any:
    from ..contract.run import Run
    from .worker import seed_globals

    call = spec["arguments"]
    seed_globals(call["seed"])
    return Run(
        seed=call["seed"],
        device=call["device"],
        threads=spec["threads"],
        seconds=spec["seconds"],
        on_progress=lambda done, total: channel.send("progress", done=done, total=total),
    )


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
