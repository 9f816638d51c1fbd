"""Where the weights of a learned method come from: shipped with it, trained by us, or a file."""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, overload

from ..errors import UsageError, did_you_mean
from ..plugins import presets
from ..plugins.registry import registry
from ..plugins.schema import defaults
from ..plugins.weights import check_fits, content, is_learned, shipped, trained_values
from .choice import NO_SENSOR, Choice, Resolved, digest
from .devices import check_name
from .numbers import WHOLE_NUMBERS, check_whole_number

AUTO, SHIPPED, TRAINED, FILE = "auto", "shipped", "trained", "file"


@dataclass
class TrainingKeys:
    """The keys of the config group ``training``."""

    weights: str = AUTO  # auto (shipped where a file fits, else trained), shipped, trained, or the name of a file
    dataset: Any = (
        None  # whose train split is learned from: a name, a preset, {name: {parameter: value}}; the cell's own
    )
    sensor: Any = None  # the same for the sensor
    cases: int = 40  # at most
    seed: int = 0
    seconds: float = 900.0  # of training, wall clock, at most; the method decides on the number of steps
    threads: int = 2
    device: str = "cpu"  # cpu or cuda


@dataclass(frozen=True)
class Training(Resolved):
    """One training of a learned method, or the place of its result.

    Attributes
    ----------
    weights : str
        ``shipped``, ``trained`` or ``file``.
    method : Choice
        The method, with only the parameters that the weights depend on.
    path, sha256 : str
        Of a file.
    task, dataset, sensor : Choice or None
        Of the cases that it is trained on; None unless ``trained``.
    """

    weights: str
    method: Choice
    path: str = ""
    sha256: str = ""
    task: Choice | None = None
    dataset: Choice | None = None
    sensor: Choice | None = None
    cases: int = 0
    seed: int = 0
    seconds: float = 0.0
    threads: int = 1
    device: str = "cpu"

    @classmethod
    def of(cls, node: Any, cell: Mapping[str, Choice]) -> Training | None:
        """From a config node and the choices of a cell; None for a method that does not learn.

        Raises
        ------
        UsageError
            Naming the key and what was expected.
        """
        method = learner_of(cell["method"])
        if method is None:
            return None
        keys = _keys(node)
        learned = Choice("method", method.name, trained_values(method.plugin, method.parameters))
        if keys.weights not in (AUTO, SHIPPED, TRAINED):
            check_fits(method.plugin, method.parameters, Path(os.path.expanduser(keys.weights)))
            return cls(FILE, learned, path=keys.weights, sha256=content(keys.weights))
        if keys.weights == SHIPPED or (keys.weights == AUTO and shipped(method.plugin, method.parameters)):
            if shipped(method.plugin, method.parameters) is None:
                raise UsageError(
                    f"training.weights=shipped: {method.label} has no shipped weights for these parameters; use "
                    "training.weights=trained, or the name of a file"
                )
            return cls(SHIPPED, learned)
        task = registry().find("task", cell["task"].name)
        return cls(
            TRAINED,
            learned,
            # With its usual parameters: weights for ratio=4 and ratio=16 need not be two trainings.
            task=Choice("task", task.name, defaults(task)),
            dataset=_choice("dataset", keys.dataset) or cell["dataset"],
            sensor=_choice("sensor", keys.sensor) or cell["sensor"],
            cases=keys.cases,
            seed=keys.seed,
            seconds=keys.seconds,
            threads=keys.threads,
            device=keys.device.partition(":")[0],
        )

    @overload
    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Training: ...

    @overload
    @classmethod
    def from_json(cls, values: None) -> None: ...

    @classmethod
    def from_json(cls, values: Mapping[str, Any] | None) -> Training | None:
        """The inverse of :meth:`to_json`."""
        if values is None:
            return None
        values = dict(values)
        for kind in ("method", "task", "dataset", "sensor"):
            if values.get(kind):
                values[kind] = Choice(**values[kind])
        return cls(**values)

    def to_json(self) -> dict[str, Any]:
        """Plain values; defaults are left out."""
        usual = {f.name: f.default for f in fields(self)}
        return {k: v for k, v in asdict(self).items() if k in ("weights", "method") or v != usual[k]}

    @functools.cached_property
    def id(self) -> str:
        """Twelve hexadecimal digits: equal wherever the same training is planned."""
        return digest(self.to_json())[:12]

    @property
    def source(self) -> tuple[Choice, Choice, Choice]:
        """The task, the dataset and the sensor of the cases that it is trained on; only of weights to be trained."""
        assert self.task is not None and self.dataset is not None and self.sensor is not None
        return self.task, self.dataset, self.sensor

    @functools.cached_property
    def choices(self) -> tuple[Choice, ...]:
        """Every plugin that takes part in the training itself."""
        if self.weights != TRAINED:
            return (self.method,)
        task, dataset, sensor = self.source
        return (self.method, task, dataset) if sensor == NO_SENSOR else (self.method, task, dataset, sensor)

    @property
    def shipped(self) -> Path | None:
        """The file that comes with the method."""
        return shipped(self.method.plugin, self.method.parameters)

    @property
    def title(self) -> str:
        """One line for people."""
        parts = [self.method.name, self.method.variant, *(c.label for c in self.choices[2:]), f"{self.cases} cases"]
        return "training of " + " ".join(part for part in (*parts, f"seed={self.seed}") if part)

    def variant(self, dataset: Choice, sensor: Choice, seed: int) -> str:
        """Its name in tables, beside the parameters of the method, in a cell with this dataset, sensor and seed.

        Nothing for shipped weights. The seed is left out where it is 0 or the cell's own.
        """
        if self.weights == SHIPPED:
            return ""
        if self.weights == FILE:
            return f"weights={Path(self.path).stem}:{self.sha256[:6]}"
        usual = TrainingKeys()
        parts = ["weights=trained"]
        _, own_dataset, own_sensor = self.source
        parts += [f"training.dataset={own_dataset.label}"] if own_dataset != dataset else []
        parts += [f"training.sensor={own_sensor.label}"] if own_sensor != sensor else []
        numbers = [(name, getattr(self, name)) for name in ("cases", "seconds", "device")]
        parts += [
            f"training.{name}={value:g}" if isinstance(value, float) else f"training.{name}={value}"
            for name, value in numbers
            if value != getattr(usual, name)
        ]
        parts += [f"training.seed={self.seed}"] if self.seed not in (0, seed) else []
        return ",".join(parts)


def identity_of(training: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a training's plain values that a cell's id depends on: a file's content, not its name."""
    return {key: value for key, value in training.items() if key not in ("path", "method")}


def learner_of(method: Choice) -> Choice | None:
    """The learned method among a method and its steps, as a choice of its own; None where nothing learns.

    Raises
    ------
    UsageError
        For several: it would be unclear to which of them a file of weights belongs.
    """
    if is_learned(method.plugin):
        return method
    steps = [
        step for step in getattr(method.made, "steps_chosen", ()) if is_learned(registry().find("method", step[0]))
    ]
    if len(steps) > 1:
        raise UsageError(f"method {method.label}: has {len(steps)} learned steps; expected one at most")
    return Choice.of("method", {"_name_": steps[0][0], **steps[0][1]}) if steps else None


def _keys(node: Any) -> TrainingKeys:
    """The keys of a node, checked."""
    values = dict(node or {})
    known = {f.name for f in fields(TrainingKeys)}
    for key in values:
        if key not in known:
            raise UsageError(f"there is no key 'training.{key}'. {did_you_mean(str(key), known)}")
    keys = TrainingKeys(**values)
    for name in WHOLE_NUMBERS:
        check_whole_number(f"training.{name}", getattr(keys, name))
    if not isinstance(keys.seconds, (int, float)) or not keys.seconds > 0:
        raise UsageError(f"training.seconds={keys.seconds}: expected a number above 0")
    keys.seconds, keys.weights = float(keys.seconds), str(keys.weights)
    check_name(str(keys.device))
    if keys.weights not in (AUTO, SHIPPED, TRAINED) and not Path(os.path.expanduser(keys.weights)).is_file():
        raise UsageError(
            f"training.weights={keys.weights}: no such file (looked for from {Path.cwd()}); expected auto, shipped, "
            "trained, or the name of a safetensors file"
        )
    return keys


def _choice(kind: str, item: Any) -> Choice | None:
    """The plugin that a key names: by its name, by a preset's, or with parameters."""
    if item in (None, ""):
        return None
    return named(kind, item, f"training.{kind}")


def named(kind: str, item: str | Mapping[str, Any], where: str) -> Choice:
    """A plugin by its name, by a preset's, or as ``{name: {parameter: value}}``.

    Raises
    ------
    UsageError
        Naming ``where`` it was asked for, and the nearest right name.
    """
    if isinstance(item, Mapping) and len(item) == 1:
        name, values = next(iter(item.items()))
        values = dict(values or {})
    elif isinstance(item, str):
        name, values = item, {}
    else:
        raise UsageError(f"{where}={item}: expected a name, or {{name: {{parameter: value}}}}")
    if name not in registry().names(kind) and name in presets.presets(kind):
        preset = presets.presets(kind)[name]
        name, values = preset.plugin, {**preset.values, **values}
    try:
        return Choice.of(kind, {"_name_": name, **values})
    except UsageError as error:
        raise UsageError(f"{where}={item}: {error}") from error
