"""The child process of a training: makes the examples, fits, and writes the weights.

The fit, with its log and checkpoints, is :class:`bench.engine.fitting.Fit`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..contract.run import Run
from ..contract.task import CaseRecipe
from ..contract.training import TrainingData, content_digest
from ..errors import BadInput, UsageError
from ..plan.training import Training, named
from ..plugins.weights import as_bytes, as_stored, content, facts_of
from ..results.files import write_atomically
from ..text import bounded
from .channel import Channel, plain
from .fitting import Fit
from .seeding import seed_globals


def work(spec: Mapping[str, Any], channel: Channel) -> None:
    """Train, and send a row with ``status`` and ``message``."""
    from .worker import failure

    asked = spec["arguments"]
    try:
        for choice in (training := Training.from_json(asked["training"])).choices:
            for plugin in choice.parts:
                plugin.require()
        channel.enter("examples", 0)
        examples, facts = _examples(training, asked, spec, channel)
        row: dict[str, Any] = {"status": "ok", "message": "", "cases": len(facts["shapes"])}
        if not asked["only_examples"]:
            row |= _fitted(training, asked, spec, channel, examples, facts)
    except BaseException as error:  # the boundary: one message for all cells that need the weights
        row = {"stage": channel.stage} | failure(error, "method")
    channel.send("result", row=plain(bounded(row)))


# -- examples ----------------------------------------------------------------------------------------------------------


def _examples(
    training: Training, asked: Mapping[str, Any], spec: Mapping[str, Any], channel: Channel
) -> tuple[Mapping[str, np.ndarray], dict[str, Any]]:
    """The examples that the method makes of the training data, from the file if it exists; and the facts about them."""
    if given := asked["from_examples"]:
        examples, facts = _known(Path(given))
        if facts.get("method") != training.method.name:
            raise BadInput(f"{given}: expected examples for {training.method.name}, got those of {facts.get('method')}")
        return examples, facts
    path = Path(asked["examples"])
    if path.is_file():
        with contextlib.suppress(BadInput):  # damaged: the examples are made again
            return _known(path)
    shapes: list[str] = []

    def see(case: Any) -> None:
        digest = content_digest(case.reference)
        if digest not in shapes:
            shapes.append(digest)
        channel.send("progress", done=len(shapes), total=training.cases)

    run = Run(seed=training.seed, threads=spec["threads"])
    method = training.method.build()
    seed_globals(training.seed)
    examples = dict(method.examples(_data(training, see), run))
    task, dataset, sensor = training.source
    facts = {
        "method": training.method.name,
        "parameters": dict(training.method.parameters),
        "task": task.name,
        "dataset": dataset.label,
        "sensor": sensor.label,
        "cases": len(shapes),
        "shapes": shapes,
        "seed": training.seed,
    }
    write_atomically(path, as_bytes(examples, facts))
    return _known(path)


def _known(path: Path) -> tuple[Mapping[str, np.ndarray], dict[str, Any]]:
    """The arrays of a file of examples, its header, and its hash."""
    facts = facts_of(path)
    return as_stored(path), {**facts, "examples": content(path)}


def _data(training: Training, see: Callable[[Any], None]) -> TrainingData:
    of_task, of_dataset, of_sensor = training.source
    task, dataset = of_task.build(), of_dataset.build()
    sensor = of_sensor.build() if of_sensor in training.choices else None

    def recipes() -> Iterator[CaseRecipe]:
        found = iter(task.recipes(dataset, sensor, split="train", count=training.cases, seed=training.seed))
        if (first := next(found, None)) is None:  # said here, before a method fails for want of an array
            raise UsageError(f"dataset {of_dataset.label} has no shapes in the split 'train'")
        yield first
        yield from found

    return TrainingData(
        recipes=recipes,
        sensor=lambda item: named("sensor", item, "TrainingData.sense").build(),
        count=training.cases,
        seed=training.seed,
        on_case=see,
    )


# -- fit ---------------------------------------------------------------------------------------------------------------


def _fitted(
    training: Training,
    asked: Mapping[str, Any],
    spec: Mapping[str, Any],
    channel: Channel,
    examples: Mapping[str, np.ndarray],
    facts: Mapping[str, Any],
) -> dict[str, Any]:
    """Fit, and write the weights with the facts about them."""
    from ..results.provenance import machine
    from .devices import make_context

    make_context(asked["device"])
    channel.enter("method", 0)
    commit = machine()["commit"] or {}
    more = {
        "threads": spec["threads"],
        "detailbench": machine()["detailbench"],
        "commit": commit.get("commit", "") + ("+" if commit.get("dirty") else ""),
        "training": asked["fingerprint"],
    }
    fit = Fit(
        training.method.build(),
        Path(asked["folder"]),
        {**facts, "seed": training.seed, "parameters": dict(training.method.parameters), **more},
        seconds=spec["seconds"],
        device=asked["device"],
        threads=spec["threads"],
        on_progress=lambda done, total: channel.send("progress", done=done, total=total),
    )
    return fit.run(examples)
