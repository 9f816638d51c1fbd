"""Trainings: each is done once, under a lock, in a child process, before the first cell that needs it.

::

    DIR/trainings/ID-FINGERPRINT/weights.safetensors      the result; the header describes how it was made
                                 /log.jsonl               losses and validations, one a line
                                 /curve.png               the validation error over time
                                 /checkpoint.safetensors  while it is not finished
                                 /failed.json             where it failed
    DIR/trainings/examples/KEY.safetensors                the examples that methods made of the training data

A killed training resumes from its last checkpoint when it is next requested. Copying ``trainings`` into
another results folder is enough to use its weights there.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import BadInput, UsageError
from ..plan.cell import Settings
from ..plan.limits import Limits
from ..plan.training import SHIPPED, TRAINED, Training
from ..plugins.weights import content, facts_of
from ..results.files import write_atomically
from ..results.provenance import examples_key, training_ingredients, weights_of
from ..results.store import Results
from .affinity import claim
from .devices import check_device, claim_device
from .forkserver import CannotStart, ServerDied, take_prestarted
from .watch import Worker

STAGE = "train"  # of the rows of cells whose training failed
WEIGHTS, CHECKPOINT, FAILED = "weights.safetensors", "checkpoint.safetensors", "failed.json"
SPARE = 1.2  # of its seconds, and
SPARE_SECONDS = 120.0  # more, before a training that does not end on its own is killed
EXAMPLES_SECONDS = 3600.0  # for making examples, where limit.setup_seconds is less


class TrainingFailed(Exception):
    """A training failed: every cell that needs it gets the row, and it is not tried again in this run."""

    def __init__(self, row: Mapping[str, Any]):
        super().__init__(row["message"])
        self.row = dict(row)


@dataclass(frozen=True)
class Weights:
    """The weights given to a method.

    Attributes
    ----------
    path : Path
    origin : str
        ``shipped``, ``trained`` or ``file``.
    facts : mapping
        The header of the file; a file from elsewhere may have less in it.
    """

    path: Path
    origin: str
    facts: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, path: Path, origin: str) -> Weights:
        """The weights in a file."""
        return cls(path, origin, facts_of(path))

    @property
    def columns(self) -> dict[str, Any]:
        """The columns of a row about them."""
        facts = self.facts
        return {
            "weights": content(self.path)[:12],
            "weights_from": self.origin,
            "train_seconds": _number(facts.get("seconds")),
            "train_cpu_seconds": _number(facts.get("cpu_seconds")),
            "train_device": facts.get("device") or "",
            "train_data": _data(facts),
            "train_cases": _number(facts.get("cases"), int),
            "train_steps": _number(facts.get("steps"), int),
        }


def _number(value: Any, kind: type = float) -> Any:
    return kind(value) if isinstance(value, (int, float)) else None


def _data(facts: Mapping[str, Any]) -> str:
    return ", ".join(str(facts[key]) for key in ("dataset", "sensor") if facts.get(key))


@dataclass(frozen=True)
class Extra:
    """The other options of the command ``train``."""

    examples: str = ""  # a file to take the examples from
    only_examples: bool = False


def folder_of(results: Results, training: Training) -> Path:
    """The folder of a training."""
    return results.folder / "trainings" / f"{training.id}-{weights_of(training)}"


def state_of(results: Results, training: Training) -> str:
    """In a word: ``finished``, ``begun``, ``failed`` or ``new``."""
    folder = folder_of(results, training)
    for name, word in ((WEIGHTS, "finished"), (CHECKPOINT, "begun"), (FAILED, "failed")):
        if (folder / name).exists():
            return word
    return "new"


def known_weights(results: Results, training: Training) -> Weights | None:
    """The weights, if they exist already."""
    if training.weights == SHIPPED:
        path = training.shipped
        if path is None:
            raise UsageError(
                f"method {training.method.label}: its shipped weights are missing; install detailbench again"
            )
        return Weights.of(path, training.weights)
    if training.weights != TRAINED:
        return Weights.of(Path(os.path.expanduser(training.path)), training.weights)
    path = folder_of(results, training) / WEIGHTS
    if not path.is_file():
        return None
    try:
        return Weights.of(path, training.weights)
    except BadInput as error:  # damaged: it is trained again, just as a damaged record is computed again
        if not results.mends:
            return None
        with contextlib.suppress(OSError):
            path.replace(path.with_suffix(".damaged"))
        results.damaged.append(f"{error}; moved aside; the method is trained again")
        return None


def weights_for(
    training: Training,
    settings: Settings,
    results: Results,
    hear: Callable[[Mapping[str, Any]], None] = lambda event: None,
    alive: Callable[[], None] = lambda: None,
    extra: Extra = Extra(),
) -> Weights:
    """The weights of a training, which runs now unless it ran before; others that need it wait.

    Parameters
    ----------
    training, settings : what and how
    results : the folder of the settings, whose owner reports what is damaged
    hear : called with events: ``train`` when it starts, ``waits`` while another process does it, ``progress``
    alive : called while waiting; raises to stop
    extra : the other options of the command ``train``

    Raises
    ------
    TrainingFailed
        With the status and the message of the failure.
    UsageError
        If it needs a device that this machine does not have.
    StoreError
        If it cannot be stored.
    """
    if not extra.only_examples and (known := known_weights(results, training)):
        return known
    waiting = {"event": "waits", "title": training.title}
    with results.lock(f"training-{training.id}", alive, lambda: hear(waiting)):
        if not extra.only_examples and (known := known_weights(results, training)):
            return known
        folder = folder_of(results, training)
        if row := _failed_before(folder, settings):
            raise TrainingFailed(row)
        check_device(training.device)
        hear({"event": "train", "title": training.title})
        row = _train(training, settings, results, hear, alive, extra)
        if row["status"] != "ok":
            failed = {**row, "stage": STAGE, "message": f"{training.title}: {row['message']}"}
            write_atomically(folder / FAILED, json.dumps({"session": settings.session, "row": failed}).encode())
            raise TrainingFailed(failed)
        (folder / FAILED).unlink(missing_ok=True)
        return (
            Weights.of(examples_file(results, training), "examples")
            if extra.only_examples
            else Weights.of(folder / WEIGHTS, training.weights)
        )


def examples_file(results: Results, training: Training) -> Path:
    """The file of a training's examples."""
    return results.folder / "trainings" / "examples" / f"{examples_key(training)}.safetensors"


def _failed_before(folder: Path, settings: Settings) -> dict[str, Any] | None:
    """How this training failed in this run; failures of earlier runs do not count."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        found = json.loads((folder / FAILED).read_bytes())
        if settings.session != "none" and found["session"] == settings.session:
            return dict(found["row"])
    return None


def _train(
    training: Training,
    settings: Settings,
    results: Results,
    hear: Callable[[Mapping[str, Any]], None],
    alive: Callable[[], None],
    extra: Extra,
) -> dict[str, Any]:
    """Train in a child process; its row, with ``status`` and ``message``."""
    folder = folder_of(results, training)
    write_atomically(folder / "about.json", json.dumps(_about(training), indent=1).encode())
    if settings.rerun == "always" and not extra.only_examples:
        (folder / CHECKPOINT).unlink(missing_ok=True)
    row: dict[str, Any] = {"status": "crashed", "message": "its process ended before it was done"}

    def on_event(event: dict[str, Any]) -> None:
        if event["event"] == "result":
            row.update(event["row"])
        else:
            hear(event)

    with contextlib.ExitStack() as stack:
        device = stack.enter_context(claim_device(training.device, alive))
        cpus = stack.enter_context(claim(training.threads))
        spec = {
            "function": "bench.engine.trainer:work",
            "arguments": {
                "training": training.to_json(),
                "folder": str(folder),
                "examples": str(examples_file(results, training)),
                "from_examples": extra.examples,
                "only_examples": extra.only_examples,
                "fingerprint": weights_of(training),
                "device": device,
            },
            "cpus": cpus,
            "threads": training.threads,
            "seconds": training.seconds,
            "memory_gb": settings.limit.train_memory_gb,
        }
        death = _watched(spec, training, settings, on_event, alive)
    if death is not None:
        row = {"status": death[0], "message": death[1], "traceback": death[2]}
    return row


def _watched(
    spec: dict[str, Any],
    training: Training,
    settings: Settings,
    hear: Callable[[dict[str, Any]], None],
    alive: Callable[[], None],
) -> tuple[str, str, str] | None:
    """Fork the trainer and follow it to its end; its status and message, and its output if it died.

    It is tried again if its fork server was killed, as a system short of memory may do.
    """
    limit = Limits(
        seconds=SPARE * training.seconds + SPARE_SECONDS,
        memory_gb=settings.limit.train_memory_gb,
        setup_seconds=max(settings.limit.setup_seconds, EXAMPLES_SECONDS),
    )
    libraries = {library for choice in training.choices for plugin in choice.parts for library in plugin.requires}
    for _ in range(2):
        with contextlib.closing(take_prestarted(training.threads)) as server:
            try:
                server.load(tuple(sorted(libraries)), settings.plugins)
                death = Worker(server, spec, limit, hear, alive, settings.verbose).watch()
            except ServerDied as error:
                return "crashed", str(error), ""
        if death is None or not death.with_server:
            break
    if death is None:
        return None
    if death.stage == "start":
        raise CannotStart("; ".join([death.message, *death.printed.splitlines()[-1:]]))
    message = death.message
    if death.status == "timeout" and death.stage == "method":
        message = (
            f"did not end by itself and was stopped after {limit.seconds:g} s (training.seconds={training.seconds:g}); "
            "fit should check run.seconds_left()"
        )
    elif death.status == "oom":
        message = message.replace("limit.memory_gb", "limit.train_memory_gb")
    return death.status, message, death.printed


def _about(training: Training) -> dict[str, Any]:
    """A description of a training, for people who look into its folder."""
    return {"title": training.title, "training": training.to_json(), "ingredients": training_ingredients(training)}


def forget(results: Results, training: Training) -> None:
    """Drop a training, to do it again."""
    shutil.rmtree(folder_of(results, training), ignore_errors=True)
