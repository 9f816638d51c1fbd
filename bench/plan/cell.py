"""Cells: one (task, dataset, sensor, method, seed, metrics), made from a composed config and checked."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from ..errors import MissingData, UsageError, did_you_mean
from ..plugins.registry import Plugin, registry
from .choice import NO_SENSOR, Choice, NotSolved, Resolved, digest
from .devices import check_name
from .keys import Base
from .limits import Limits
from .numbers import WHOLE_NUMBERS, check_whole_number
from .training import TRAINED, Training, identity_of


@dataclass(frozen=True)
class Settings:
    """How a cell is run; nothing here changes the result of a finished case."""

    results: str = "results"
    limit: Limits = field(default_factory=Limits)
    outputs: str = "none"
    rerun: str = "never"
    verbose: bool = False
    plugins: tuple[str, ...] = ()
    profile: str = "quick"
    session: str = "none"  # the run that it belongs to


@dataclass(frozen=True)
class Cell(Resolved):
    """One unit of a sweep: a method with its parameters on the cases of one dataset, sensor and seed."""

    task: Choice
    dataset: Choice
    sensor: Choice
    method: Choice
    metrics: tuple[Choice, ...]
    seed: int = 0
    split: str = "test"
    cases: int = 4
    threads: int = 1
    device: str = "cpu"
    training: Training | None = None  # the source of the weights of a learned method

    @functools.cached_property
    def choices(self) -> tuple[Choice, ...]:
        """Every plugin that takes part."""
        sensor = () if self.sensor == NO_SENSOR else (self.sensor,)
        return (self.task, self.dataset, *sensor, self.method, *self.metrics)

    @functools.cached_property
    def id(self) -> str:
        """Twelve hexadecimal digits: equal wherever the same cell is planned."""
        return id_of(self.to_json())

    @functools.cached_property
    def planned(self) -> int:
        """The number of cases to run: ``cases``, or the number that the dataset reports, if that is smaller."""
        return self.cases if self._there is None else min(self.cases, self._there)

    @property
    def left_out(self) -> str:
        """``2 of 6 cases left out (cases=4)``, and other data that a dataset ignores; empty if none is known."""
        rest = (self._there or 0) - self.cases
        text = f"{rest} of {self._there} cases left out (cases={self.cases})" if rest > 0 else ""
        ignored = getattr(self.dataset.made, "ignored", str)  # without it: nothing is ignored
        return "; ".join(filter(None, (text, ignored())))

    @functools.cached_property
    def _there(self) -> int | None:
        count = getattr(self.dataset.made, "count", None)
        return count(self.split) if callable(count) else None

    @property
    def variant(self) -> str:
        """The differences from the defaults of the method, and from its usual training."""
        trained = self.training.variant(self.dataset, self.sensor, self.seed) if self.training else ""
        return ",".join(filter(None, (self.method.variant, trained)))

    @property
    def title(self) -> str:
        """One line for people."""
        trained = self.training.variant(self.dataset, self.sensor, self.seed) if self.training else ""
        method = f"{self.method.label} ({trained})" if trained else self.method.label
        parts = [self.task.label, self.dataset.label, self.sensor.label, method, f"seed={self.seed}"]
        return " ".join(part for part in parts if part != "none")

    def to_json(self) -> dict[str, Any]:
        """Plain values, from which :meth:`from_json` makes the same cell."""
        values = asdict(self)
        del values["training"]  # left out if there is none: other cells keep their ids
        return values if self.training is None else {**values, "training": self.training.to_json()}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Cell:
        """The inverse of :meth:`to_json`."""
        values = dict(values)
        for kind in ("task", "dataset", "sensor", "method"):
            values[kind] = Choice(**values[kind])
        values["metrics"] = tuple(Choice(**m) for m in values["metrics"])
        values["training"] = Training.from_json(values.get("training"))
        return cls(**values)

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> Cell:
        """From a composed config, with every name, parameter and combination checked.


        Raises
        ------
        UsageError
            Naming the key, what was expected, and the nearest right name.
        """
        task, method = Choice.of("task", config["task"]), Choice.of("method", config["method"])
        if not method.solves(task.name):
            raise NotSolved(_cannot_solve(method, task.name))
        for key in WHOLE_NUMBERS:
            check_whole_number(key, config[key])
        one_of("split", config["split"], ("test", "train"))
        check_name(config["device"])
        dataset = Choice.of("dataset", config["dataset"])
        sensor = _sensor(config["sensor"], task, dataset)
        parts = {"task": task, "dataset": dataset, "sensor": sensor, "method": method}
        training = Training.of(config.get("training"), parts)
        if training and training.weights == TRAINED:
            _, learned_from, seen_by = training.source
            _sensor_fits(seen_by, task, learned_from)
            check_dataset(learned_from.build(), "train")
        cell = cls(
            task=task,
            dataset=dataset,
            sensor=sensor,
            method=method,
            training=training,
            metrics=_metrics(config.get("metric") or {}, task),
            **{key: config[key] for key in ("seed", "split", "cases", "threads", "device")},
        )
        check_dataset(cell.dataset.build(), cell.split)
        return cell


def id_of(values: Mapping[str, Any]) -> str:
    """The id of the cell with these plain values, as :meth:`Cell.to_json` gives them; no plugin is looked at."""
    training = values.get("training")
    if isinstance(training, Mapping):
        values = {**values, "training": identity_of(training)}
    return digest(values)[:12]


def check_dataset(dataset: Any, split: str) -> None:
    """Call a dataset's ``check()`` or ``check(split)``, if it has one.

    Raises
    ------
    NotSolved
        If its data were not fetched: such cells are left out, like those of a task that a method does not solve.
    """
    check = getattr(dataset, "check", None)
    try:
        if check:
            check(split) if inspect.signature(check).parameters else check()
    except MissingData as error:
        raise NotSolved(str(error)) from error


def settings_of(config: Mapping[str, Any]) -> Settings:
    """The settings in a composed config, checked."""
    one_of("outputs", config["outputs"], ("none", "first", "all"))
    one_of("rerun", config["rerun"], ("never", "failed", "always"))
    limit = Limits(**config["limit"])
    check_limits(limit)
    return Settings(
        results=config["results"],
        limit=limit,
        outputs=config["outputs"],
        rerun=config["rerun"],
        verbose=config["verbose"],
        plugins=tuple(config["plugins"]),
        profile=config["profile"],
        session=config.get("session", "none"),
    )


def check_limits(limit: Limits) -> None:
    """Raise :class:`UsageError` for a limit that is not above 0."""
    for key, value in asdict(limit).items():
        if not value > 0 and not (key == "cache_gb" and value == 0):
            raise UsageError(f"limit.{key}={value}: expected more than 0")


def check_root(config: Mapping[str, Any]) -> None:
    """Refuse keys that nothing reads: Hydra accepts ``+typo=3``."""
    from .keys import GROUPS

    known = {f.name for f in fields(Base)} | set(GROUPS)
    for key in config:
        if key not in known:
            raise UsageError(f"there is no key {key!r}. {did_you_mean(str(key), known)}")
    for key, value in (*config.items(), *((f"limit.{key}", value) for key, value in config["limit"].items())):
        if value == "???":
            raise UsageError(f"{key}=???: expected a value")
    for key in config["limit"]:
        if key not in asdict(Limits()):
            raise UsageError(f"there is no key 'limit.{key}'. {did_you_mean(str(key), asdict(Limits()))}")


def one_of(key: str, value: str, known: tuple[str, ...]) -> None:
    """Raise :class:`UsageError` unless ``value`` is one of ``known``."""
    if value not in known:
        raise UsageError(f"{key}={value}: not one of {', '.join(known)}. {did_you_mean(str(value), known)}")


USUAL_SENSOR = "samples"  # what conf/config.yaml chooses


def _sensor(node: Mapping[str, Any], task: Choice, dataset: Choice) -> Choice:
    """The chosen sensor, which must turn the dataset's shapes into the task's input; none for a task without one."""
    from ..contract.sensors import taken_by

    if taken_by(task.made) == "none":
        return NO_SENSOR
    return _sensor_fits(sensor_of(node, dataset.plugin), task, dataset)


def sensor_of(node: Mapping[str, Any] | None, dataset: Plugin) -> Choice:
    """The sensor that a dataset is scanned with; scans that come with its shapes are used as they are by default."""
    sensor = Choice.of("sensor", node)
    if dataset.options.get("scans") and sensor == Choice.of("sensor", {"_name_": USUAL_SENSOR}):
        return Choice.of("sensor", {"_name_": "scan"})
    return sensor


def _sensor_fits(sensor: Choice, task: Choice, dataset: Choice) -> Choice:
    """The sensor, which must turn the dataset's shapes into the task's input."""
    from ..contract.sensors import given_by, needs_a_source, taken_by

    takes = taken_by(task.made)
    if takes == "none":
        return NO_SENSOR
    plugin, built = sensor.plugin, sensor.made
    gives = given_by(plugin, built)
    if gives != takes:
        fitting = [s.name for s in registry().all("sensor") if given_by(s, s.cls()) == takes]
        raise NotSolved(
            f"task {task.name} takes {takes}, but sensor {sensor.name} gives {gives}. "
            f"Sensors that give {takes}: {', '.join(fitting) or 'none'}"
        )
    if needs_a_source(plugin, built):
        raise NotSolved(
            f"sensor {sensor.name} only degrades {gives} that another sensor gives: "
            f"sensor=chain 'sensor.steps=[NAME,{sensor.name}]'"
        )
    _check_scans(sensor, dataset)
    return sensor


def _check_scans(sensor: Choice, dataset: Choice) -> None:
    """Raise :class:`NotSolved` if one of the two is for scans that come with the shapes, and the other is not."""
    from ..contract.sensors import gives_scans

    brings, gives = bool(dataset.plugin.options.get("scans")), gives_scans(sensor.plugin, sensor.made)
    if brings and not gives:
        raise NotSolved(
            f"dataset {dataset.name} has its own scans, and sensor {sensor.label} would make others: leave the sensor "
            "out, put it after the scan (sensor=chain 'sensor.steps=[scan,...]'), or scan the references with "
            "dataset=files"
        )
    if gives and not brings:
        having = ", ".join(p.name for p in registry().all("dataset") if p.options.get("scans"))
        raise NotSolved(
            f"sensor {sensor.label} gives scans that come with the shapes, and dataset {dataset.name} has none. "
            f"Datasets with scans: {having or 'none'}"
        )


def _metrics(nodes: Mapping[str, Any], task: Choice) -> tuple[Choice, ...]:
    """The chosen metrics that apply to the output of the task, by name."""
    kind = getattr(task.plugin.cls, "output", "cloud")
    chosen = [Choice.of("metric", node, f"metric.{name}") for name, node in nodes.items()]
    fitting = [m for m in chosen if kind in m.plugin.options.get("outputs", ("mesh", "cloud"))]
    if not fitting:
        names = [m.name for m in registry().all("metric") if kind in m.options.get("outputs", ("mesh", "cloud"))]
        raise UsageError(f"metric: none of the chosen metrics scores a {kind}. Known: {', '.join(names)}")
    return tuple(sorted(fitting, key=lambda m: m.name))


def _cannot_solve(method: Choice, task: str) -> str:
    solves = [t for t in registry().names("task") if method.solves(t)]
    others = [m.name for m in registry().all("method") if m.solves(task)]
    what = f"it solves {', '.join(solves)}" if solves else "it has no function named after a task"
    return f"method {method.label} does not solve {task}: {what}. Methods that do: {', '.join(others) or 'none'}"


# The wording of _cannot_solve.
CANNOT_SOLVE = re.compile(r"method (?P<method>\S+) does not solve (?P<task>\w+):")


def not_planned(messages: Iterable[str]) -> list[str]:
    """Why pairs of a sweep are left out, each reason once, and all methods that do not solve a task in one line."""
    messages = list(dict.fromkeys(messages))
    methods: dict[str, list[str]] = {}
    for found in filter(None, map(CANNOT_SOLVE.match, messages)):
        methods.setdefault(found["task"], []).append(found["method"])
    if sum(map(len, methods.values())) < 2:
        return messages
    pairs = "; ".join(f"{task} by {', '.join(names)}" for task, names in methods.items())
    line = f"{pairs}: these methods do not solve it; `detailbench list methods` shows which do"
    return [line, *(message for message in messages if not CANNOT_SOLVE.match(message))]


def reference_name(dataset: str, case: str) -> str:
    """The file of a case's reference below ``outputs/references``, for a dataset by its name in results.

    With other parameters a dataset has other shapes under the same ids.
    """
    name, _, parameters = dataset.partition("[")
    return f"{name}-{digest(parameters)[:8]}-{case}.ply" if parameters else f"{name}-{case}.ply"
