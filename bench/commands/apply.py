"""Apply one method to one file, or to many.

  detailbench apply method=poisson scan.ply mesh.ply method.depth=9
  detailbench apply method=rimls task=denoise scan.ply clean.ply
  detailbench apply method=poisson 'scans/*.ply' meshes/
  detailbench apply method=poisson scans 'meshes/*.obj' --simplify 50000 --colors
  detailbench apply method=identity task=detail_transfer source.ply source_base.ply target_base.ply out.ply
  detailbench apply method=NAME task=multiview FOLDER mesh.ply

INPUT is a point cloud (PLY, PCD, LAS, E57, NPY, or text: XYZ, CSV, PTS, ...) or a mesh, whose vertices are the points.
OUTPUT is in the coordinates of INPUT, a mesh as PLY, OBJ, STL, OFF or GLB, a cloud as PLY, PCD, XYZ, TXT or CSV.
Colours, intensity and other numbers of the points of INPUT are copied to the points of OUTPUT. Parameters that are
lengths refer to the frame in which the input has radius 1.

Many files: INPUT is a folder, a pattern in quotes, or several files; OUTPUT is a folder, or a name that ends in /, or a
pattern such as 'OUT/*.obj', which sets the file type; * is the name of the input. A file that fails is reported, and
the others are processed. An output of the same input with the same settings is not made again, except with --again.

A detail transfer takes three meshes that are aligned with each other, or two where the source has no base; OUTPUT and
that frame are the target base's.
FOLDER has images with masks and cameras: transforms.json, cameras.npz, or a COLMAP model as text (docs/multiview.md).
`detailbench list task NAME` describes the inputs of other tasks.
Where a method solves several tasks, task= chooses one; an output file that may be a mesh or a cloud becomes a mesh
(task=reconstruct). normals=file (the default) reads the normals of a cloud from its file, if it has any;
normals=estimate ignores them. A learned method uses the weights that come with it, or those of
training.weights=FILE (detailbench train). All processors are used unless threads= sets their number. Further keys:
seed, device, limit.seconds, limit.memory_gb.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..cli import add_plugin_argument
from ..errors import DetailbenchError, UsageError, did_you_mean
from ..plugins.registry import load_plugins, registry
from ..text import one_line

if TYPE_CHECKING:
    from ..engine.application import Application

CLOUD_SUFFIXES = (".xyz", ".txt", ".asc", ".csv", ".pcd", ".pts")
NORMALS = ("file", "estimate")
MESH_SUFFIXES = (".obj", ".stl", ".off", ".glb")
DEFAULT_TASK = "reconstruct"  # also the default of `run`


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("words", nargs="+", metavar="method=NAME INPUT OUTPUT [key=value ...]")
    text = "reduce a mesh to this number of faces, and report the distance between the two"
    parser.add_argument("--simplify", type=int, default=0, metavar="FACES", help=text)
    parser.add_argument("--colors", action="store_true", help="give vertices the colours of the nearest input points")
    parser.add_argument("--again", action="store_true", help="with many files: make cached outputs again")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Read, call the method in a child process, write; report what was made."""
    from ..engine.affinity import available
    from ..engine.forkserver import prestart
    from ..engine.targets import names_a_folder
    from ..sweep.request import Request

    plugins = load_plugins(args.plugin)
    files = [word for word in args.words if is_file(word)]
    overrides = [word for word in args.words if word not in files]
    if len(files) < 2:
        raise UsageError(f"expected an INPUT and an OUTPUT file, got {', '.join(files) or 'none'}")
    if args.simplify and args.simplify < 4:
        raise UsageError(f"--simplify {args.simplify}: expected a number of faces, at least 4")
    if not any(word.partition("=")[0] == "threads" for word in overrides):
        overrides.append(f"threads={len(available())}")
    prestart(Request.of([word for word in overrides if word.startswith("threads=")]).threads)
    jobs = jobs_of(overrides, files, plugins, args.simplify, args.colors)
    if not names_a_folder(files[-1]):
        return _one(jobs[0], traceback=bool(args.plugin))
    return _many(jobs, again=args.again)


def is_file(word: str) -> bool:
    """Whether an argument is a file name, which may contain ``=``, and not a key with its value."""
    from ..geometry.io.files import CLOUD_READERS
    from ..sweep.overrides import is_key
    from ..sweep.quoting import is_override

    if not is_override(word) or os.path.exists(word):
        return True
    key, _, value = word.lstrip("+").partition("=")
    if key == "normals" or is_key(key):
        return False
    suffixes = {*CLOUD_READERS, *CLOUD_SUFFIXES, *MESH_SUFFIXES}
    return "/" in key or value.endswith("/") or Path(value).suffix.lower() in suffixes


# -- what is to be done ------------------------------------------------------------------------------------------------


def jobs_of(
    overrides: Sequence[str], files: Sequence[str], plugins: tuple[str, ...], simplify: int = 0, colors: bool = False
) -> list[Application]:
    """The applications described by the arguments, checked."""
    from ..engine.application import Application
    from ..engine.targets import targets_of
    from ..plan.cell import check_limits, check_root
    from ..plan.choice import Choice
    from ..plan.devices import check_name
    from ..plan.limits import Limits
    from ..plan.numbers import check_whole_number
    from ..plan.training import Training
    from ..sweep.overrides import checked

    *inputs, output = files
    overrides, normals = _normals_of(overrides)
    overrides = _with_task(overrides, output, inputs)
    values = checked(overrides, "apply").values
    check_root(values)
    for key in ("seed", "threads"):
        check_whole_number(key, values[key])
    check_name(values["device"])
    task, method = (Choice.of(kind, values[kind]) for kind in ("task", "method"))
    if not method.solves(task.name):
        raise UsageError(f"method {method.label} does not solve {task.name}")
    if simplify and task.made.output != "mesh":
        raise UsageError(f"--simplify {simplify}: task {task.name} does not output a mesh")
    targets = targets_of(inputs, output, task.made)
    folder = Path(output).absolute().parent
    if not folder.is_dir() and len(targets) == 1 and targets[0].output == output:
        raise UsageError(f"{output}: no such folder: {folder}; create it first")
    # A user's own file has no limits by default; the limits of a benchmark apply only on request.
    asked = {w.lstrip("+").split("=")[0] for w in overrides}
    given = {name: value for name, value in values["limit"].items() if f"limit.{name}" in asked}
    limit = Limits(**({"seconds": 86400.0, "memory_gb": _memory_gb()} | given))
    check_limits(limit)
    first = Application(
        task=task,
        method=method,
        training=Training.of(values["training"], _parts(values, task, method)),
        results=values["results"],
        inputs=(),
        output=output,
        seed=values["seed"],
        threads=values["threads"],
        device=values["device"],
        normals=normals,
        simplify=simplify,
        colors=colors,
        limit=limit,
        plugins=plugins,
        verbose=values["verbose"],
    )
    return [replace(first, inputs=target.inputs, output=target.output) for target in targets]


def _with_task(overrides: list[str], output: str, inputs: Sequence[str]) -> list[str]:
    """The overrides with a task, and the method checked."""
    from ..plan.choice import Choice
    from ..plugins.presets import resolve
    from ..sweep.overrides import checked

    of_task = [w for w in overrides if w.startswith("task.")]  # may determine the task
    others = [w for w in overrides if w not in of_task]
    request = checked(others, "apply")
    if not any(w.startswith("method=") for w in overrides):
        raise UsageError("choose a method: detailbench apply method=NAME INPUT OUTPUT (detailbench list methods)")
    registry().find("method", resolve("method", request.chosen("method")[0]))  # or an error that names it
    if any(w.startswith("task=") for w in overrides):
        return overrides
    # With its parameters: a chain solves what its last step solves.
    method = Choice.of("method", request.values["method"])
    return [*overrides, f"task={_task_for(method, output, inputs, of_task)}"]


def _parts(values: dict[str, Any], task: Any, method: Any) -> dict[str, Any]:
    """The choices that a training depends on."""
    from ..plan.choice import Choice

    of = {kind: Choice.of(kind, values[kind]) for kind in ("dataset", "sensor")}
    return {"task": task, "method": method, **of}


def _normals_of(overrides: Sequence[str]) -> tuple[list[str], str]:
    """The overrides without ``normals=``, which benchmarks do not have, and its value."""
    given = [w.partition("=")[2] for w in overrides if w.partition("=")[0] == "normals"]
    for value in given:
        if value not in NORMALS:
            raise UsageError(f"normals={value}: expected one of {', '.join(NORMALS)}. {did_you_mean(value, NORMALS)}")
    return [w for w in overrides if w.partition("=")[0] != "normals"], given[-1] if given else NORMALS[0]


def _memory_gb() -> float:
    import psutil

    return 0.9 * psutil.virtual_memory().total / 2**30


def _task_for(method: Any, output: str, inputs: Sequence[str], parameters: list[str]) -> str:
    """The task determined by a method, the kind of the output file, the inputs, and the parameters given to it
    (``task.ratio=4``). If both a mesh and a cloud are possible, it is the mesh, and a message says so.
    """
    from ..engine.targets import names_a_folder

    tasks = [t for t in registry().names("task") if method.solves(t)]
    is_folder = "*" not in output and names_a_folder(output)
    suffix = "" if is_folder else Path(output).suffix.lower()
    kinds = {"mesh"} if suffix in MESH_SUFFIXES else {"cloud"} if suffix in CLOUD_SUFFIXES else {"mesh", "cloud"}
    classes = {t: registry().find("task", t).cls for t in tasks}
    fitting = [t for t, c in classes.items() if getattr(c, "output", "cloud") in kinds]
    if tasks and not fitting:
        from ..geometry.io.files import CLOUD_WRITERS, MESH_WRITERS

        made, other = ("mesh", MESH_WRITERS) if kinds == {"cloud"} else ("cloud", CLOUD_WRITERS)
        raise UsageError(f"{output}: method {method.name} gives a {made}; expected one of {' '.join(other)}")
    if not names_a_folder(output):  # each of many inputs is a separate call
        fitting = [t for t in fitting if len(inputs) in getattr(classes[t], "files", (1,))] or fitting
    if not os.path.isdir(inputs[0]):  # images are in folders
        fitting = [t for t in fitting if getattr(classes[t], "takes", "cloud") != "views"] or fitting
    named = {word.partition("=")[0].partition(".")[2].partition(".")[0] for word in parameters}
    fitting = [t for t in fitting if named <= {f.name for f in registry().find("task", t).fields}] or fitting
    if len(fitting) == 1:
        return fitting[0]
    if not tasks:
        raise UsageError(f"method {method.name} solves none of the known tasks")
    if DEFAULT_TASK in fitting:
        others = " or ".join(f"task={t}" for t in fitting if t != DEFAULT_TASK)
        print(f"task={DEFAULT_TASK}; {method.name} also solves {others}", file=sys.stderr)
        return DEFAULT_TASK
    choice = " or ".join(f"task={t}" for t in (fitting or tasks))
    raise UsageError(f"method {method.name} solves {', '.join(tasks)}: add {choice}")


# -- one file ----------------------------------------------------------------------------------------------------------


def _one(job: Application, traceback: bool) -> int:
    """Apply to one file, and report what was made."""
    from ..engine.application import Applier
    from ..sweep.progress import Steps

    label = job.method.label
    with Steps(label) as steps, Applier(job) as apply:
        result = apply(job, steps.event)
    if result["status"] != "ok":
        if traceback and result.get("traceback"):
            print(result["traceback"], file=sys.stderr)
        raise DetailbenchError(_named(job, _why(result)))
    given = f" ({result['input']})" if result["input"] else ""
    print(f"{' '.join(job.inputs)}{given} -> {job.output} ({result['output']})")
    stages = ", ".join(f"{name} {seconds:.2g} s" for name, seconds in result["stages"].items())
    if origin := result.get("external"):  # it has no times and no memory
        print(f"{label}: external: {origin} ({stages})")
    else:
        print(f"{label}: {result['seconds']:.3g} s, peak {result['peak_rss_mb']:.0f} MB ({stages})")
    for note in result["notes"]:
        print(f"{label}: note: {_without_name(job, note)}")
    return 0


def _why(result: dict[str, Any]) -> str:
    status = "" if result["status"] in ("error", "skipped") else f"{result['status']}: "
    return f"{status}{result['message']}"


def _named(job: Application, text: str) -> str:
    """A message with the name of the method, once."""
    return f"{job.method.label}: {_without_name(job, text)}"


def _without_name(job: Application, text: str) -> str:
    """A message without the names already printed before it."""
    return text.removeprefix(f"{job.method.name}: ")


# -- many files --------------------------------------------------------------------------------------------------------


def _many(jobs: list[Application], again: bool) -> int:
    """Apply to one file after the other, and print a table of what was made; 3 where a file could not be done."""
    from ..engine import applied
    from ..engine.application import Applier
    from ..sweep.progress import Steps

    rows: list[dict[str, Any]] = []
    with Steps(jobs[0].method.label) as steps, Applier(jobs[0]) as apply:
        for number, job in enumerate(jobs, 1):
            count = f"[{number}/{len(jobs)}]"
            steps.begin(f"{count} {job.inputs[0]}")
            mark = applied.fingerprint(job)
            known = None if again else applied.recorded(job, mark)
            result = known or apply(job, steps.event)
            if known is None and result["status"] == "ok":
                applied.record(job, mark, result)
            rows.append(result | {"is_cached": known is not None})
            steps.show(f"{count} {_line(job, rows[-1])}")
    print(_table(jobs, rows))
    for job, row in zip(jobs, rows, strict=True):
        if text := _note(job, row):
            print(f"  {job.inputs[0]}: {text}")
    failed = sum(row["status"] != "ok" for row in rows)
    there = sum(row["is_cached"] for row in rows)
    print(
        f"{jobs[0].method.label}: {len(jobs) - failed} of {len(jobs)} files done"
        + (f", {there} of them cached (--again makes them again)" if there else "")
    )
    return 3 if failed else 0


def _line(job: Application, row: dict[str, Any]) -> str:
    """The outcome of one file."""
    if row["status"] != "ok":
        return f"{job.inputs[0]}: {_note(job, row).splitlines()[0]}"
    took = "external" if row.get("external") else f"in {row['seconds']:.3g} s"
    return f"{job.inputs[0]} -> {job.output} ({row['output']}) {'cached' if row['is_cached'] else took}"


def _note(job: Application, row: dict[str, Any]) -> str:
    """The note on a file below the table."""
    text = _without_name(job, row["message"] if row["status"] == "ok" else _why(row))
    return text.removeprefix(f"{job.inputs[0]}: ").strip()


def _table(jobs: list[Application], rows: list[dict[str, Any]]) -> str:
    """One line for each file: input, output, and cost."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    columns = {"points": "input_points", "vertices": "output_points", "faces": "output_faces", "pieces": "pieces"}
    if not any(row.get("output_faces") is not None for row in rows):
        columns = {"points": "input_points", "output": "output_points"}
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 2, 0, 0), header_style="")
    table.add_column("file")
    for title in (*columns, "seconds", "MB"):
        table.add_column(title, justify="right")
    table.add_column("note")
    for job, row in zip(jobs, rows, strict=True):
        counts = [f"{row[key]:,}" if row.get(key) is not None else "" for key in columns.values()]
        costs = [f"{row[key]:{form}}" if row.get(key) is not None else "" for key, form in COSTS.items()]
        note = "see below" if _note(job, row) else ""
        note = row["status"] if row["status"] != "ok" else "cached" if row["is_cached"] else note
        table.add_row(Text(one_line(job.inputs[0])), *counts, *costs, note)
    text = io.StringIO()
    Console(file=text, width=160, highlight=False).print(table)
    return "\n".join(line.rstrip() for line in text.getvalue().splitlines())


COSTS = {"seconds": ".3g", "peak_rss_mb": ".0f"}
