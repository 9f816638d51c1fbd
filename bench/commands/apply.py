"""Apply one method to one file.

  detailbench apply method=poisson scan.ply mesh.ply method.depth=9
  detailbench apply method=rimls task=denoise scan.ply clean.ply
  detailbench apply method=identity task=detail_transfer source.ply source_base.ply target_base.ply out.ply
  detailbench apply method=NAME task=multiview FOLDER mesh.ply

INPUT is a point cloud (PLY, XYZ, TXT, OBJ) or a mesh whose vertices are taken; OUTPUT is in the coordinates of INPUT,
as PLY, OBJ, STL, OFF or GLB. Parameters that are lengths refer to the frame in which the input has radius 1.
A detail transfer takes three meshes that are aligned with each other, or two where the source has no base; OUTPUT and
that frame are the target base's.
FOLDER has images with masks and cameras: transforms.json, cameras.npz, or a COLMAP model as text (docs/multiview.md).
What other tasks take, their `read` says (detailbench list task NAME).
Where a method solves several tasks, task= says which. normals=file (the default) takes the normals of a cloud from its
file, where it has any; normals=estimate takes none of them. A learned method takes the weights that come with it, or
those of training.weights=FILE (detailbench train). Further keys: seed, threads, device, limit.seconds,
limit.memory_gb.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from ..cli import add_plugin_argument
from ..errors import DetailbenchError, UsageError, did_you_mean
from ..plugins.registry import load_plugins, registry

CLOUD_SUFFIXES = (".xyz", ".txt", ".pts", ".csv")
NORMALS = ("file", "estimate")
MESH_SUFFIXES = (".obj", ".stl", ".off", ".glb")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("words", nargs="+", metavar="method=NAME INPUT OUTPUT [key=value ...]")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Read, call the method in a child process, write; say what was made."""
    from ..engine.application import apply
    from ..engine.forkserver import begin
    from ..sweep.overrides import is_override, threads_of
    from ..sweep.progress import Steps

    plugins = load_plugins(args.plugin)
    overrides = [w for w in args.words if is_override(w)]
    files = [w for w in args.words if not is_override(w)]
    if len(files) < 2:
        raise UsageError(f"expected an INPUT and an OUTPUT file, got {', '.join(files) or 'none'}")
    begin(threads_of(overrides))
    job = job_of(overrides, files, plugins)
    with Steps(f"{job.method.label}") as steps:
        result = apply(job, steps.event)
    if result["status"] != "ok":
        if args.plugin and result.get("traceback"):
            print(result["traceback"], file=sys.stderr)
        status = "" if result["status"] in ("error", "skipped") else f"{result['status']}: "
        raise DetailbenchError(f"{job.method.label}: {status}{result['message']}")
    given = f" ({result['input']})" if result["input"] else ""
    print(f"{' '.join(files[:-1])}{given} -> {job.output} ({result['output']})")
    print(f"{job.method.label}: {result['seconds']:.3g} s, peak {result['peak_rss_mb']:.0f} MB")
    if result["message"]:
        print(f"{job.method.label}: note: {result['message']}")
    return 0


def job_of(overrides: list[str], files: list[str], plugins: tuple[str, ...]) -> Any:
    """The application that the words describe, checked."""
    from ..engine.application import Application
    from ..plan.cell import check_root
    from ..plan.choice import Choice
    from ..plan.limits import Limits
    from ..plan.training import Training
    from ..plugins.presets import resolve
    from ..sweep.composition import resolved
    from ..sweep.overrides import check_overrides, chosen

    overrides, normals = _normals_of(overrides)
    of_task = [w for w in overrides if w.startswith("task.")]  # may tell which task is meant
    check_overrides([w for w in overrides if w not in of_task], multirun=False)
    if not any(w.startswith("method=") for w in overrides):
        raise UsageError("choose a method: detailbench apply method=NAME INPUT OUTPUT (detailbench list methods)")
    registry().find("method", resolve("method", chosen("method", overrides)[0]))  # or a message that has its name
    *inputs, output = files
    if not any(w.startswith("task=") for w in overrides):
        # With its parameters: a chain solves what its last step solves.
        values = resolved([w for w in overrides if w not in of_task])
        method = Choice.of("method", values["method"])
        overrides = [*overrides, f"task={_task_for(method, output, len(inputs), of_task)}"]
    check_overrides(overrides, multirun=False)
    values = resolved(overrides)
    check_root(values)
    task = Choice.of("task", values["task"])
    chosen_method = Choice.of("method", values["method"])
    if not chosen_method.solves(task.name):
        raise UsageError(f"method {chosen_method.label} does not solve {task.name}")
    for path in inputs:
        if not Path(path).exists():
            raise UsageError(f"{path}: no such file")
    if not Path(output).absolute().parent.is_dir():
        raise UsageError(f"{output}: there is no folder {Path(output).absolute().parent}")
    # A file of one's own may take its time; a benchmark's limits are for those who ask for them.
    asked = {w.lstrip("+").split("=")[0] for w in overrides}
    limit = {name: value for name, value in values["limit"].items() if f"limit.{name}" in asked}
    return Application(
        task=task,
        method=chosen_method,
        training=Training.of(values["training"], _parts(values, task, chosen_method)),
        results=values["results"],
        inputs=tuple(inputs),
        output=output,
        seed=values["seed"],
        threads=values["threads"],
        device=values["device"],
        normals=normals,
        limit=Limits(**({"seconds": 86400.0, "memory_gb": _memory_gb()} | limit)),
        plugins=plugins,
        verbose=values["verbose"],
    )


def _parts(values: dict[str, Any], task: Any, method: Any) -> dict[str, Any]:
    """The choices that a training depends on."""
    from ..plan.choice import Choice

    of = {kind: Choice.of(kind, values[kind]) for kind in ("dataset", "sensor")}
    return {"task": task, "method": method, **of}


def _normals_of(overrides: list[str]) -> tuple[list[str], str]:
    """The overrides without ``normals=``, which no benchmark has, and its value."""
    given = [w.partition("=")[2] for w in overrides if w.partition("=")[0] == "normals"]
    for value in given:
        if value not in NORMALS:
            raise UsageError(f"normals={value}: expected one of {', '.join(NORMALS)}. {did_you_mean(value, NORMALS)}")
    return [w for w in overrides if w.partition("=")[0] != "normals"], given[-1] if given else NORMALS[0]


def _memory_gb() -> float:
    import psutil

    return 0.9 * psutil.virtual_memory().total / 2**30


def _task_for(method: Any, output: str, inputs: int, parameters: list[str]) -> str:
    """The task that a method, the kind of the output file, the number of inputs, and the parameters that are given to
    it (``task.ratio=4``) leave no doubt about."""
    tasks = [t for t in registry().names("task") if method.solves(t)]
    suffix = Path(output).suffix.lower()
    kinds = {"mesh"} if suffix in MESH_SUFFIXES else {"cloud"} if suffix in CLOUD_SUFFIXES else {"mesh", "cloud"}
    classes = {t: registry().find("task", t).cls for t in tasks}
    fitting = [t for t, c in classes.items() if getattr(c, "output", "cloud") in kinds]
    if tasks and not fitting:
        from ..geometry.io.files import CLOUD_WRITERS, MESH_WRITERS

        made, other = ("mesh", MESH_WRITERS) if kinds == {"cloud"} else ("cloud", CLOUD_WRITERS)
        raise UsageError(f"{output}: method {method.name} gives a {made}; expected one of {' '.join(other)}")
    fitting = [t for t in fitting if inputs in getattr(classes[t], "files", (1,))] or fitting
    named = {word.partition("=")[0].partition(".")[2].partition(".")[0] for word in parameters}
    fitting = [t for t in fitting if named <= {f.name for f in registry().find("task", t).fields}] or fitting
    if len(fitting) == 1:
        return fitting[0]
    if not tasks:
        raise UsageError(f"method {method.name} solves no task that is known here")
    choice = " or ".join(f"task={t}" for t in (fitting or tasks))
    raise UsageError(f"method {method.name} solves {', '.join(tasks)}: add {choice}")
