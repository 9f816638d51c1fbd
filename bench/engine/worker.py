"""The child process: runs one cell's cases and streams each row to the runner as soon as it is finished.

Nothing that happens in here can hurt the runner. What a method raises becomes the status of its row; what kills the
process becomes, in the runner, the status of the case that was being worked on.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import json
import math
import os
import random
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from ..contract.artefacts import Artefacts
from ..contract.case import Case
from ..contract.identity import shape_digest
from ..contract.run import Run
from ..contract.sensors import noun_of
from ..errors import BadInput, InvalidOutput, MissingLibrary, UsageError
from ..geometry.cloud import PointCloud
from ..plan.cell import Cell, Choice
from ..plugins.registry import missing_library
from ..results import imputation
from ..results.kept_outputs import FOLDER, file_name, reference_file
from ..seeds import generator
from .devices import check_device, make_context
from .memo import Memo, RememberedDataset, RememberedSensor
from .meter import Meter


class Channel:
    """Lines of JSON to the runner.

    Attributes
    ----------
    stage : str
        What is being done, as the runner was told last.
    """

    def __init__(self, fd: int):
        self._file = os.fdopen(fd, "wb", buffering=0)
        self._owner = os.getpid()
        self.stage = "start"

    def send(self, event: str, **values: Any) -> None:
        """Send one event. A process that a method forked has nothing to say here, and ends."""
        if os.getpid() != self._owner:
            os._exit(0)
        line = json.dumps({"event": event, **values}).encode() + b"\n"
        while line:
            line = line[self._file.write(line) or 0 :]

    def enter(self, stage: str, index: int) -> None:
        """Say what is done from now on, for which case: the runner watches the limits of that stage."""
        self.stage = stage
        self.send("begin", index=index, stage=stage)


def work(spec: dict[str, Any], fd: int) -> None:
    """Run the job of ``spec`` and report to the file descriptor ``fd``.

    ``spec`` holds ``cpus`` (processors to pin to), ``threads``, ``seconds``, ``memory_gb``, and either ``cell`` (a
    benchmark cell) or ``function`` (``module:name`` of ours, called with the spec and the channel; see
    :mod:`bench.engine.isolate`).
    """
    channel = Channel(fd)
    faulthandler.enable()
    if spec.get("cpus") and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, spec["cpus"])
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(spec["threads"])
    if "function" in spec:
        module, _, name = spec["function"].partition(":")
        getattr(importlib.import_module(module), name)(spec, channel)
    else:
        _Session(spec, channel).run()
    channel.send("done")


class _Session:
    """One cell's work in this process."""

    def __init__(self, spec: dict[str, Any], channel: Channel):
        self.spec, self.channel = spec, channel
        self.cell = Cell.from_json(spec["cell"])
        self.done = set(spec["done"])  # indices of cases that need not be run
        self.owed = set(spec["owed"])  # and those of them whose worst scores are not known
        self.case: Case | None = None  # the one that was worked on last
        self.device = spec.get("device", self.cell.device)  # `cuda` may have become cuda:1, where the first was taken
        self.meter = Meter(spec["memory_gb"], self.device)
        # All that is remembered depends on the dataset; what depends on more says so where it is remembered.
        self.memo = Memo(Path(spec["cache"]), spec["keys"]["dataset"], spec["cache_gb"])

    def run(self) -> None:
        """Plan the cases, then run those that are not done."""
        self.channel.enter("plan", -1)
        try:
            task, recipes = self.plan()
        except BaseException as error:  # the boundary: the runner writes it on every planned case
            self.channel.send("no_plan", row={"stage": "plan"} | failure(error, "plan"))
            return
        self.channel.send("cases", ids=[recipe.id for recipe in recipes])
        for index, recipe in enumerate(recipes):
            owed = index in self.owed
            if index not in self.done:
                row = {"case": recipe.id, "case_index": index, "started": now()}
                row |= self.run_case(index, recipe, task)
                self.channel.send("row", row=plain(row | {"finished": now()}))
                owed = imputation.lacks_worst(row)
            if owed:
                self.send_worst(index, recipe, task)

    def plan(self) -> tuple[Any, list[Any]]:
        """The task, and the recipes of its cases; nothing is made yet."""
        cell = self.cell
        for choice in cell.choices:
            if choice.kind != "method":
                for plugin in choice.parts:
                    plugin.require()
        check_device(self.device)
        task = cell.task.build()
        sensor = cell.sensor.build() if cell.sensor in cell.choices else None
        noun = noun_of(cell.sensor.plugin, sensor) if sensor is not None else None
        if noun is not None:
            sensor = RememberedSensor(sensor, self.memo.at("sensor", self.spec["keys"]["sensor"]), noun)
        dataset = RememberedDataset(cell.dataset.build(), self.memo)
        recipes = list(task.recipes(dataset, sensor, split=cell.split, count=cell.cases, seed=cell.seed))
        ids = [recipe.id for recipe in recipes]
        if len(set(ids)) < len(ids):
            raise UsageError(f"dataset {cell.dataset.label}: two cases have one id: {max(ids, key=ids.count)!r}")
        return task, recipes

    def made(self, recipe: Any) -> Case:
        """The case of a recipe, with its corner of the memory."""
        case = recipe.build()
        # Two tasks may make cases of one id with other references, and a task may do so itself.
        parts = (self.spec["keys"]["task"], self.cell.split, case.seed, case.id, shape_digest(case.reference))
        case._memo = self.memo.at("case", *parts)
        return case

    def run_case(self, index: int, recipe: Any, task: Any) -> dict[str, Any]:
        """The row of one case; whatever is raised on the way is its status."""
        row: dict[str, Any] = {}
        self.case = None
        try:
            self.channel.enter("case", index)
            self.case = case = self.made(recipe)
            row["tags"] = ",".join(case.tags)
            row |= conditions(task, case)
            output = self.call_method(index, case, task, row)
            task.validate(output, case.input)
            self.channel.enter("score", index)
            row |= sizes(output) | self.score(output, case)
            row |= self.keep(index, case, output)
        except BaseException as error:  # the boundary: every failure becomes a status, none is lost
            if os.getpid() != self.channel._owner:
                os._exit(1)
            return row | {"stage": self.channel.stage} | failure(error, self.channel.stage)
        return {"message": ""} | row | {"status": "ok", "stage": "", "traceback": ""}

    def call_method(self, index: int, case: Case, task: Any, row: dict[str, Any]) -> Any:
        """The output of the method; into the row goes what clock and memory say of that call alone."""
        cell = self.cell
        self.channel.enter("prepare", index)
        cell.method.plugin.require()
        make_context(self.device)
        method = cell.method.build()
        prepare(method)
        seed = int(generator(cell.seed, case.id, "run").integers(2**31))
        seed_globals(seed)
        trace: list[dict[str, Any]] = []
        files = self.artefacts(index, case, lambda text: run.note(text))
        run = Run(
            seed=seed,
            device=self.device,
            threads=cell.threads,
            seconds=self.spec["seconds"],
            on_progress=lambda done, total: self.channel.send("progress", done=done, total=total),
            on_trace=lambda output, seconds, keep=False: self.traced(
                output, seconds, case, task, trace, files if keep else None
            ),
            on_keep=(lambda name, value: self.keep_artefact(files, name, value)) if files else None,
            on_distances=(lambda points: self.distances(points, case)) if len(case.reference.mesh.faces) else None,
        )
        self.channel.enter("method", index)
        try:
            with self.meter:
                run._started, run._paused = time.perf_counter(), 0.0
                return task.solve(method, cell.task.name, dict(case.input), run)
        finally:
            row |= self.meter.figures()
            row |= {"parameters": run.parameters, "active_parameters": run.active_parameters}
            row["message"] = "; ".join(run.notes)
            row["true_distances"] = run.distances_given or None
            if trace:
                row["trace"] = json.dumps(plain(trace))
            if files and files.paths:
                row["artefacts"] = json.dumps(files.paths)

    def traced(
        self,
        output: Any,
        seconds: float,
        case: Case,
        task: Any,
        trace: list[dict[str, Any]],
        files: Artefacts | None = None,
    ) -> None:
        """Score an intermediate result while the clock stands still; store it too where ``files`` is given."""
        with self.off_the_clock():
            entry: dict[str, Any] = {"seconds": seconds}
            try:
                output = output() if callable(output) else output
                task.validate(output, case.input)
                entry |= self.score(output, case, floors=False)
            except InvalidOutput as error:
                entry["message"] = str(error)
            else:
                if files and (path := files.keep(f"trace-{len(trace):03d}", output)):
                    entry["artefact"] = path
            trace.append(entry)

    def artefacts(self, index: int, case: Case, note: Callable[[str], None]) -> Artefacts | None:
        """Where a case stores what its method gives to ``run.keep``; None where the settings ask for no outputs."""
        if not self.keeps(index):
            return None
        results = Path(self.spec["results"])
        return Artefacts(results / self.outputs / file_name(case.id, ""), results, note)

    def keep_artefact(self, files: Artefacts, name: str, value: Any) -> None:
        """Store one artefact while the clock stands still."""
        with self.off_the_clock():
            files.keep(name, value)

    def distances(self, points: np.ndarray, case: Case) -> np.ndarray:
        """Signed distances to the reference mesh, while the clock stands still: a paper samples them beforehand."""
        from ..geometry.signed_distance import signed_distances

        with self.off_the_clock():
            return signed_distances(case.reference.mesh, points)

    @contextlib.contextmanager
    def off_the_clock(self) -> Iterator[None]:
        """Neither the time of the call nor its limit runs; what happens in here has limit.setup_seconds."""
        self.channel.send("pause")
        try:
            with self.meter.paused():
                yield
        finally:
            self.channel.send("resume")

    def score(self, output: Any, case: Case, *, floors: bool = True) -> dict[str, Any]:
        """``score.<key>`` of every metric, ``floor.<key>`` where it has one, and which way each is better."""
        row: dict[str, Any] = {}
        directions = {}
        for choice in self.cell.metrics:
            metric, plugin = choice.build(), choice.plugin
            try:
                scores = metric.score(output, case)
                floor = self.floor(choice, metric, output, case) if floors and plugin.options.get("floor") else {}
            except Exception as error:
                error.add_note(f"while scoring {choice.name}")
                raise
            directions |= {key: plugin.better(key) for key in scores}
            row |= {f"score.{key}": float(value) for key, value in scores.items()}
            row |= {f"floor.{key}": float(value) for key, value in floor.items()}
        return row | ({"directions": json.dumps(directions, sort_keys=True)} if floors else {})

    def floor(self, choice: Choice, metric: Any, output: Any, case: Case) -> dict[str, float]:
        """What a perfect output, in kind and count, would score: the same for all methods that return as many.

        A metric may look at the input of the case, so each sensor has floors of its own.
        """
        kind = f"{len(output)} points" if isinstance(output, PointCloud) else "mesh"

        def scored() -> dict[str, np.ndarray]:
            return {key: np.float64(value) for key, value in metric.score(case.perfect(output), case).items()}

        keys = self.spec["keys"]
        name = f"floor of {choice.name} {keys[f'metric {choice.name}']} for {kind} from {keys['sensor']}"
        return {key: float(value) for key, value in case.remember(name, scored).items()}

    @property
    def outputs(self) -> str:
        """Where the outputs of this cell are kept, relative to the results folder."""
        return f"{FOLDER}/{self.cell.id}-{self.spec['fingerprint']}"

    def keeps(self, index: int) -> bool:
        """Whether the settings ask for the outputs of a case."""
        return self.spec["outputs"] == "all" or (self.spec["outputs"] == "first" and index == 0)

    def send_worst(self, index: int, recipe: Any, task: Any) -> None:
        """Tell the runner what a failure is worth on this case.

        After the case's row: whatever happens here, the result of the method is safe, and its clock and memory are as
        they were.
        """
        self.channel.enter("worst", index)
        case, self.case = self.case, None
        try:
            row = self.worst(self.made(recipe) if case is None else case, task)
        except Exception as error:  # the boundary: the case has its row, and does without these values
            print(f"{recipe.id}: cannot score hopeless outputs: {error!r}", file=sys.stderr)
            return
        self.channel.send("worst", index=index, row=plain(row))

    def worst(self, case: Case, task: Any) -> dict[str, Any]:
        """``worst.<key>`` of every metric: what the worst output scores that knows nothing of the case."""
        row: dict[str, Any] = {}
        directions: dict[str, str] = {}
        if not hasattr(task, "hopeless"):
            return row
        keys = self.spec["keys"]
        kind = f"{self.cell.task.label}, {task.expected(case.input)} points"
        for choice in self.cell.metrics:
            name = f"worst of {choice.name} {keys[f'metric {choice.name}']} for {kind} from {keys['sensor']}"
            scores = case.remember(name, lambda choice=choice: self.worst_of(choice, case, task))
            row |= {f"{imputation.PREFIX}{key}": float(value) for key, value in scores.items()}
            directions |= {key: choice.plugin.better(key) for key in scores}
        return row | ({"directions": json.dumps(directions, sort_keys=True)} if directions else {})

    def worst_of(self, choice: Choice, case: Case, task: Any) -> dict[str, np.ndarray]:
        """The worst scores of one metric. Fewer samples than usual do: no hopeless output is near the reference."""
        from ..geometry.comparison import set_samples

        metric, outputs = choice.build(), task.hopeless(case)
        rough = replace(case, _cache={})
        set_samples(rough, imputation.SAMPLES)
        hopeless = []
        for output in outputs:
            # A metric of a user may refuse what the tasks never let through; it then has no worst score.
            with contextlib.suppress(Exception):
                hopeless.append(metric.score(output, rough))
        perfect = self.floor(choice, metric, outputs[0], case) if hopeless else {}
        worst = imputation.worst_scores(hopeless, perfect, choice.plugin.better)
        return {key: np.float64(value) for key, value in worst.items()}

    def keep(self, index: int, case: Case, output: Any) -> dict[str, str]:
        """Write the output, and its reference, as PLY files where the settings ask for it.

        Returns
        -------
        dict
            ``output`` and ``reference``: their paths, relative to the results folder. The second is no column; the
            metadata of the record has it.
        """
        if not self.keeps(index):
            return {"output": ""}
        from ..geometry.io.files import save

        folder = Path(self.spec["results"])
        kept = f"{self.outputs}/{file_name(case.id)}"
        reference = reference_file(self.cell.dataset.name, case.id, case.reference)
        save(output, folder / kept)
        if not (folder / reference).exists():
            save(case.reference.mesh, folder / reference)
        return {"output": kept, "reference": reference}


# -- failures ----------------------------------------------------------------------------------------------------------


def failure(error: BaseException, stage: str) -> dict[str, str]:
    """Status, message and traceback of what was raised."""
    notes = "".join(f" ({note})" for note in getattr(error, "__notes__", ()))
    text = str(error).strip()
    message = f"{type(error).__name__}: {text}" if text else type(error).__name__
    status = "error"
    if isinstance(error, InvalidOutput):
        status, message = "invalid", text
    elif isinstance(error, MemoryError) or _is_out_of_memory(error):
        status, message = "oom", f"{message} (past the memory limit)"
    elif isinstance(error, ImportError) and stage in ("method", "prepare", "plan") and not _is_ours(error):
        missing = error if isinstance(error, MissingLibrary) else missing_library(error)
        status, message = "skipped", str(missing)
    elif isinstance(error, (BadInput, UsageError)):
        message = text
    elif isinstance(error, SystemExit):
        message = f"called sys.exit({error.code!r})"
    told = status in ("invalid", "skipped") or isinstance(error, (BadInput, UsageError))  # by the message, wholly
    trace = "" if told else "".join(traceback.format_exception(error))
    return {"status": status, "message": message + notes, "traceback": trace}


def _is_ours(error: ImportError) -> bool:
    """Whether what cannot be imported is a module of this package: a mistake in it, no library to install."""
    return (error.name or "").partition(".")[0] == __package__.partition(".")[0]


def _is_out_of_memory(error: BaseException) -> bool:
    """Whether a library said in its own words that it could not allocate."""
    return type(error).__name__ == "OutOfMemoryError" or (
        isinstance(error, (RuntimeError, OSError)) and any(w in str(error).lower() for w in OUT_OF_MEMORY)
    )


# How libraries say it, in lower case; the runner looks for the same words in what a dying process printed.
OUT_OF_MEMORY = (
    "bad_alloc",
    "bad alloc",
    "out of memory",
    "cannot allocate memory",
    "can't allocate memory",
    "not enough memory",
    "memoryerror",
)


def prepare(method: Any) -> None:
    """Let a method make or fetch what it keeps: weights, say. That is no part of the call, nor of its limit."""
    if hasattr(method, "prepare"):
        method.prepare()


def conditions(task: Any, case: Case) -> dict[str, float]:
    """``input.<key>`` of what the task can tell of a case's input: how noisy, how complete, how even it really is."""
    describe = getattr(task, "describe", None)
    return {f"input.{key}": float(value) for key, value in describe(case).items()} if describe else {}


# -- small things ------------------------------------------------------------------------------------------------------


def seed_globals(seed: int) -> None:
    """Seed the global generators: nothing of ours draws from them, somebody's method may, and must be repeatable."""
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002
    if "torch" in sys.modules:
        sys.modules["torch"].manual_seed(seed)
    if "open3d" in sys.modules:
        sys.modules["open3d"].utility.random.seed(seed)


def sizes(output: Any) -> dict[str, int]:
    """How large an output is."""
    if isinstance(output, PointCloud):
        return {"output_points": len(output)}
    if hasattr(output, "vertices") and hasattr(output, "faces"):
        return {"output_points": len(output.vertices), "output_faces": len(output.faces)}
    return {}


def now(seconds: float = 0.0) -> str:
    """The time in so many seconds, UTC, ISO 8601."""
    return (datetime.now(UTC) + timedelta(seconds=seconds)).isoformat(timespec="milliseconds")


def plain(value: Any) -> Any:
    """As JSON can hold it: numpy scalars become Python's, not-a-number becomes null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else value
    return value
