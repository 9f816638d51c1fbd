"""The child process: runs one cell's cases and streams each row to the runner as soon as it is finished.

Nothing that happens in here can hurt the runner. What a method raises becomes the status of its row; what kills the
process becomes, in the runner, the status of the current case.
"""

from __future__ import annotations

import contextlib
import faulthandler
import functools
import importlib
import json
import os
import sys
import traceback
from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from ..contract.case import Case
from ..contract.identity import shape_digest
from ..contract.sensors import gives_scans, noun_of
from ..contract.training import content_digest
from ..errors import BadInput, InvalidOutput, MissingLibrary, UsageError
from ..geometry.cloud import PointCloud
from ..geometry.comparison import NeedsSurface
from ..geometry.traits import Traits, all_tags, measure_traits
from ..notices import collected
from ..plan.cell import Cell
from ..plan.choice import Choice
from ..plugins.registry import missing_library
from ..plugins.weights import load
from ..results import imputation
from ..results.kept_outputs import FOLDER, file_name, reference_file
from ..seeds import generator
from ..text import bounded
from .call import MeasuredCall, Scores, floor, score
from .channel import Channel, plain
from .devices import check_device
from .memo import Memo, RememberedDataset, RememberedSensor
from .meter import Meter
from .state import changes, state
from .yardstick import reference_seconds

LONGEST_ID = 200  # characters of a case's id: it names files


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
        Session(spec, channel).run()
    channel.send("done")


class Session:
    """One cell's work in this process."""

    def __init__(self, spec: dict[str, Any], channel: Channel):
        self.spec, self.channel = spec, channel
        self.cell = Cell.from_json(spec["cell"])
        self.done = set(spec["done"])  # indices of cases that need not be run
        self.owed = set(spec["owed"])  # those of them whose worst scores are not known
        self.changed: list[str] = []  # what a call has changed in this process
        self.case: Case | None = None  # the one at hand, if it is made
        self.device = spec.get("device", self.cell.device)  # `cuda` may have become cuda:1, where the first was taken
        self.meter = Meter(spec["memory_gb"], self.device)
        self.weights: Mapping[str, Any] = spec.get("weights") or {}
        # Everything cached depends on the dataset; further dependencies are added where it is cached.
        self.memo = Memo(Path(spec["cache"]), spec["keys"]["dataset"], spec["cache_gb"])

    def run(self) -> None:
        """Plan the cases, then run those that are not done."""
        self.channel.enter("plan", -1)
        try:
            task, recipes = self.plan()
        except BaseException as error:  # the boundary: the runner writes it on every planned case
            self.channel.send("no_plan", row=bounded({"stage": "plan"} | failure(error, "plan")))
            return
        self.channel.send("cases", ids=[recipe.id for recipe in recipes])
        for index, recipe in enumerate(recipes):
            if self.changed:
                print(
                    f"{recipe.id}: runs in a new process, because the call before it changed {', '.join(self.changed)}"
                )
                self.channel.send("replace")
                return
            self.case = None
            owed = index in self.owed
            if index not in self.done:
                row = {"case": recipe.id, "case_index": index, "started": now()}
                row |= self.run_case(index, recipe, task)
                self.channel.send("row", row=plain(bounded(row | {"finished": now()})))
                owed = imputation.lacks_worst(row)
            if owed:
                self.send_worst(index, recipe, task)

    def plan(self) -> tuple[Any, list[Any]]:
        """The task, and its lazy cases; nothing is made yet."""
        cell = self.cell
        for choice in cell.choices:
            if choice.kind != "method":
                for plugin in choice.parts:
                    plugin.require()
        check_device(self.device)
        task = cell.task.build()
        sensor = cell.sensor.build() if cell.sensor in cell.choices else None
        noun = noun_of(cell.sensor.plugin, sensor) if sensor is not None else None
        if noun is not None and not gives_scans(cell.sensor.plugin, sensor):  # which the user supplies as files
            sensor = RememberedSensor(sensor, self.memo.at("sensor", self.spec["keys"]["sensor"]), noun)
        dataset = RememberedDataset(cell.dataset.build(), self.memo)
        recipes = list(task.recipes(dataset, sensor, split=cell.split, count=cell.cases, seed=cell.seed))
        ids = [recipe.id for recipe in recipes]
        if len(set(ids)) < len(ids):
            raise UsageError(f"dataset {cell.dataset.label}: two cases have one id: {max(ids, key=ids.count)!r}")
        if (longest := max(map(len, ids), default=0)) > LONGEST_ID:
            raise UsageError(
                f"dataset {cell.dataset.label}: an id of {longest:,} letters; expected {LONGEST_ID} at most"
            )
        return task, recipes

    def made(self, recipe: Any) -> Case:
        """The case made from a lazy case, with its part of the cache."""
        case = recipe.build()
        # Two tasks may make cases of one id with other references, and a task may do so itself.
        parts = (self.spec["keys"]["task"], self.cell.split, case.seed, case.id, shape_digest(case.reference))
        case._memo = self.memo.at("case", *parts)
        return case

    def tags(self, case: Case) -> tuple[str, ...]:
        """The measured traits of the reference's surface, and the tags that the dataset declares."""
        if case.reference.cloud is not None:  # only surfaces have traits
            return case.tags
        mesh = case.reference.mesh
        memo = self.memo.at("traits", shape_digest(case.reference))
        known = memo.arrays("traits", lambda: measure_traits(mesh.vertices, mesh.faces).arrays())
        return all_tags(Traits.of(known), case.tags)

    def run_case(self, index: int, recipe: Any, task: Any) -> dict[str, Any]:
        """The row of one case; an exception on the way becomes its status."""
        row: dict[str, Any] = {}
        read: list[str] = []  # for instance notices about the user's own files
        try:
            self.channel.enter("case", index)
            with collected(read):
                self.case = case = self.made(recipe)
                row["tags"] = ",".join(self.tags(case))
                row |= conditions(task, case)
            if failed := self.weights.get("failed"):  # the training of the method: its row has the status and message
                return row | {key: failed.get(key, "") for key in ("status", "stage", "message", "traceback")}
            self.check_training(case)
            row["reference_seconds"] = reference_seconds()
            call, before = self.measured_call(index, case, task), state()
            try:
                output = call()
            finally:
                row |= call.columns
                self.changed = changes(before)
            self.channel.enter("score", index)
            with collected() as notices:
                scores = self.score(output, case)
            row |= sizes(output) | scores.columns | {"directions": json.dumps(scores.directions, sort_keys=True)}
            row |= self.keep(index, case, output)
            reasons = [f"no {names}: {reason}" for reason, names in grouped(scores.left_out).items()]
            said = row.get("message", "")
            notices = [text for text in notices if text not in said]  # a traced output may have been scored before
            row["message"] = "; ".join(filter(None, [*read, said, *notices, *reasons]))
        except BaseException as error:  # the boundary: every failure becomes a status, none is lost
            if os.getpid() != self.channel._owner:
                os._exit(1)
            notes = [*read, row.get("message", "")]
            return row | {"stage": self.channel.stage} | failure(error, self.channel.stage, notes)
        return {"message": ""} | row | {"status": "ok", "stage": "", "traceback": ""}

    def check_training(self, case: Case) -> None:
        """Check that the weights were trained on other shapes.

        Raises
        ------
        BadInput
            If they were trained on this shape.
        """
        if self.weights.get("shapes") and content_digest(case.reference) in self.weights["shapes"]:
            raise BadInput(
                f"{case.id}: the weights were trained on this very shape, so a score of it would say nothing; test on "
                "others, or train on others (training.dataset=NAME)"
            )

    @functools.cached_property
    def arrays(self) -> Mapping[str, np.ndarray] | None:
        """The weights, read once."""
        return load(self.weights["path"]) if "path" in self.weights else None

    def measured_call(self, index: int, case: Case, task: Any) -> MeasuredCall:
        """The call of the method on one case."""
        cell, results = self.cell, Path(self.spec["results"])
        return MeasuredCall(
            task=cell.task,
            method=cell.method,
            solver=task,
            inputs=case.input,
            seed=int(generator(cell.seed, case.id, "run").integers(2**31)),
            spec=self.spec,
            meter=self.meter,
            channel=self.channel,
            index=index,
            case=case.id,
            reference=case.reference,
            weights=self.arrays,
            trace_score=lambda output: self.score(output, case, floors=False).columns,
            store=(results / self.outputs / file_name(case.id, ""), results) if self.keeps(index) else None,
        )

    def score(self, output: Any, case: Case, *, floors: bool = True) -> Scores:
        """The scores of an output by the metrics of the cell."""
        return score(self.cell.metrics, output, case, floors=floors, keys=self.spec["keys"])

    @property
    def outputs(self) -> str:
        """The folder of this cell's outputs, relative to the results folder."""
        return f"{FOLDER}/{self.cell.id}-{self.spec['fingerprint']}"

    def keeps(self, index: int) -> bool:
        """Whether the settings ask for the outputs of a case."""
        return self.spec["outputs"] == "all" or (self.spec["outputs"] == "first" and index == 0)

    def send_worst(self, index: int, recipe: Any, task: Any) -> None:
        """Send the runner the scores that a failure gets on this case.

        After the case's row: whatever happens here, the result of the method is safe, and its clock and memory are as
        they were.
        """
        self.channel.enter("worst", index)
        try:
            with collected():  # the notices are in the case's row already
                row = self.worst(self.case or self.made(recipe), task)
        except Exception as error:  # the boundary: the case has its row, and these values are left out
            print(f"{recipe.id}: cannot score the outputs of hopeless(): {error!r}", file=sys.stderr)
            return
        self.channel.send("worst", index=index, row=plain(row))

    def worst(self, case: Case, task: Any) -> dict[str, Any]:
        """``worst.<key>`` of every metric: the score of the worst output that ignores the case."""
        row: dict[str, Any] = {}
        directions: dict[str, str] = {}
        if not hasattr(task, "hopeless"):
            return row
        keys = self.spec["keys"]
        kind = f"{self.cell.task.label}, {task.expected(case.input)} points"
        for choice in self.cell.metrics:
            name = f"worst of {choice.name} {keys[f'metric {choice.name}']} for {kind} from {keys['sensor']}"
            scores = case.remember(name, functools.partial(self.worst_of, choice, case, task))
            row |= {f"{imputation.PREFIX}{key}": float(value) for key, value in scores.items()}
            directions |= {key: choice.plugin.better(key) for key in scores}
        return row | ({"directions": json.dumps(directions, sort_keys=True)} if directions else {})

    def worst_of(self, choice: Choice, case: Case, task: Any) -> dict[str, np.ndarray]:
        """The worst scores of one metric. Fewer samples than usual suffice: such outputs are far from the reference."""
        from ..geometry.comparison import set_samples

        metric, outputs = choice.build(), task.hopeless(case)
        rough = replace(case, _cache={})
        set_samples(rough, imputation.SAMPLES)
        hopeless = []
        for output in outputs:
            # A user's metric may refuse outputs that tasks never let through; it then has no worst score.
            with contextlib.suppress(Exception):
                hopeless.append(metric.score(output, rough))
        if not hopeless:
            return {}
        try:
            if case.reference.cloud is None:
                perfect = floor(choice, metric, outputs[0], case, self.spec["keys"])
            else:  # a reference cloud has no second sample
                perfect = metric.score(case.reference.cloud, case)
        except NeedsSurface:
            return {}
        worst = imputation.worst_scores(hopeless, perfect, choice.plugin.better)
        return {key: np.asarray(value) for key, value in worst.items()}

    def keep(self, index: int, case: Case, output: Any) -> dict[str, str]:
        """Write the output, and its reference, as PLY files where the settings ask for it.

        Returns
        -------
        dict
            ``output`` and ``reference``: their paths, relative to the results folder. The second is not a column; the
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
            save(case.reference.mesh if case.reference.cloud is None else case.reference.cloud, folder / reference)
        return {"output": kept, "reference": reference}


# -- failures ----------------------------------------------------------------------------------------------------------


def failure(error: BaseException, stage: str, notes: Iterable[str] = ()) -> dict[str, str]:
    """Status, message and traceback of what was raised; ``notes`` were given before, and may explain it."""
    added = [f"note: {note}" for note in notes if note]
    remarks = "".join(f" ({remark})" for remark in (*getattr(error, "__notes__", ()), *added))
    try:
        text = str(error).strip()
    except Exception as inner:  # a method's own exception class may do anything
        text = f"its text cannot be shown ({type(inner).__name__})"
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
    return {"status": status, "message": message + remarks, "traceback": trace}


def _is_ours(error: ImportError) -> bool:
    """Whether the missing module is one of this package: a mistake in it, not a library to install."""
    return (error.name or "").partition(".")[0] == __package__.partition(".")[0]


def _is_out_of_memory(error: BaseException) -> bool:
    """Whether a library reported in its own words that it could not allocate."""
    return type(error).__name__ == "OutOfMemoryError" or (
        isinstance(error, (RuntimeError, OSError)) and any(w in str(error).lower() for w in OUT_OF_MEMORY)
    )


# Their messages, in lower case; the runner searches the output of a dying process for the same.
OUT_OF_MEMORY = (
    "bad_alloc",
    "bad alloc",
    "out of memory",
    "cannot allocate memory",
    "can't allocate memory",
    "not enough memory",
    "memoryerror",
)


def conditions(task: Any, case: Case) -> dict[str, float]:
    """``input.<key>`` of the measured conditions of a case's input: its true noise, completeness and evenness."""
    describe = getattr(task, "describe", None)
    return {f"input.{key}": float(value) for key, value in describe(case).items()} if describe else {}


# -- small things ------------------------------------------------------------------------------------------------------


def grouped(left_out: Mapping[str, str]) -> dict[str, str]:
    """The metrics that are left out, by reason."""
    names: dict[str, list[str]] = {}
    for name, reason in left_out.items():
        names.setdefault(reason, []).append(name)
    return {reason: ", ".join(of) for reason, of in names.items() if reason}


def sizes(output: Any) -> dict[str, int]:
    """The size of an output."""
    if isinstance(output, PointCloud):
        return {"output_points": len(output)}
    if hasattr(output, "vertices") and hasattr(output, "faces"):
        return {"output_points": len(output.vertices), "output_faces": len(output.faces)}
    return {}


def now(seconds: float = 0.0) -> str:
    """The time in ``seconds`` from now, UTC, ISO 8601."""
    return (datetime.now(UTC) + timedelta(seconds=seconds)).isoformat(timespec="milliseconds")
