"""Cells: one (task, dataset, sensor, method, seed, metrics), made from a composed config and checked."""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from ..errors import MissingData, UsageError, did_you_mean
from ..plugins.registry import Plugin, registry
from ..plugins.schema import NAME_KEY, build, parameters, variant
from .devices import check_name
from .keys import Base
from .limits import Limits


class NotSolved(UsageError):
    """Two choices that do not fit: a sweep leaves such a pair out of its plan and says so.

    The method has no function for the task, or the sensor does not give what the task takes.
    """


class _Resolved:
    """A frozen dataclass whose cached properties stay with the object: a copy, pickled or not, resolves anew."""

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]


@dataclass(frozen=True)
class Choice(_Resolved):
    """One plugin with all its parameters, as JSON values."""

    kind: str
    name: str
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @functools.cached_property
    def plugin(self) -> Plugin:
        """The registered plugin."""
        return registry().find(self.kind, self.name)

    def build(self) -> Any:
        """A new plugin object: for each case its own, since a plugin may keep state."""
        return build(self.plugin, self.parameters)

    @functools.cached_property
    def made(self) -> Any:
        """One plugin object, for questions that do not change it: what it takes, gives, reads and consists of."""
        return self.build()

    @functools.cached_property
    def parts(self) -> tuple[Plugin, ...]:
        """The plugin, and those that it is made of where its parameters name others: the steps of a chain."""
        return (self.plugin, *getattr(self.made, "plugins", ()))

    @functools.cached_property
    def variant(self) -> str:
        """Parameters that differ from the defaults."""
        return variant(self.plugin, self.parameters) if self.parameters else ""

    @functools.cached_property
    def label(self) -> str:
        """``bumps``, ``bumps[degree=20]`` where parameters differ from the defaults, or the name of their preset."""
        from ..plugins.presets import name_of

        preset = name_of(self.plugin, self.parameters) if self.parameters else None
        if preset:
            return preset
        return f"{self.name}[{self.variant}]" if self.variant else self.name

    @classmethod
    def of(cls, kind: str, node: Mapping[str, Any], where: str | None = None) -> Choice:
        """From a config node; every parameter is checked and completed."""
        if not isinstance(node, Mapping) or NAME_KEY not in node:
            raise UsageError(f"{where or kind}: choose a {kind} by name, for instance {kind}={_example(kind)}")
        from ..plugins.reads import check_files

        plugin = registry().find(kind, node[NAME_KEY])
        choice = cls(kind, plugin.name, parameters(plugin, build(plugin, node)))
        vars(choice)["plugin"] = plugin  # found just now
        check_files(choice)
        return choice


def _example(kind: str) -> str:
    names = registry().names(kind)
    return names[0] if names else "NAME"


NO_SENSOR = Choice("sensor", "none")


@dataclass(frozen=True)
class Settings:
    """How a cell is run; nothing here changes what a finished case says."""

    results: str = "results"
    limit: Limits = field(default_factory=Limits)
    outputs: str = "none"
    rerun: str = "never"
    verbose: bool = False
    plugins: tuple[str, ...] = ()
    profile: str = "quick"


@dataclass(frozen=True)
class Cell(_Resolved):
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

    @functools.cached_property
    def choices(self) -> tuple[Choice, ...]:
        """Every plugin that takes part."""
        sensor = () if self.sensor == NO_SENSOR else (self.sensor,)
        return (self.task, self.dataset, *sensor, self.method, *self.metrics)

    @functools.cached_property
    def id(self) -> str:
        """Twelve hexadecimal digits: equal wherever the same cell is planned."""
        return digest(self.to_json())[:12]

    @property
    def title(self) -> str:
        """One line for people."""
        parts = [self.task.label, self.dataset.label, self.sensor.label, self.method.label, f"seed={self.seed}"]
        return " ".join(part for part in parts if part != "none")

    def to_json(self) -> dict[str, Any]:
        """Plain values, from which :meth:`from_json` makes the same cell."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Cell:
        """The inverse of :meth:`to_json`."""
        values = dict(values)
        for kind in ("task", "dataset", "sensor", "method"):
            values[kind] = Choice(**values[kind])
        values["metrics"] = tuple(Choice(**m) for m in values["metrics"])
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
        if not method.plugin.solves(task.name):
            raise NotSolved(_cannot_solve(method.plugin, task.name))
        for key, least in (("cases", 1), ("threads", 1), ("seed", 0)):
            if config[key] < least:
                raise UsageError(f"{key}={config[key]}: expected at least {least}")
        one_of("split", config["split"], ("test", "train"))
        check_name(config["device"])
        sensor = _sensor(config["sensor"], task)
        cell = cls(
            task=task,
            dataset=Choice.of("dataset", config["dataset"]),
            sensor=sensor,
            method=method,
            metrics=_metrics(config.get("metric") or {}, task),
            **{key: config[key] for key in ("seed", "split", "cases", "threads", "device")},
        )
        check_dataset(cell.dataset.build(), cell.split)
        return cell


def check_dataset(dataset: Any, split: str) -> None:
    """Call a dataset's ``check()`` or ``check(split)``, if it has one.

    Raises
    ------
    NotSolved
        Where its data were not fetched: such cells are left out, as those of a task that a method does not solve.
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
    for key, value in asdict(limit).items():
        if not value > 0 and not (key == "cache_gb" and value == 0):
            raise UsageError(f"limit.{key}={value}: expected more than 0")
    return Settings(
        results=config["results"],
        limit=limit,
        outputs=config["outputs"],
        rerun=config["rerun"],
        verbose=config["verbose"],
        plugins=tuple(config["plugins"]),
        profile=config["profile"],
    )


def check_root(config: Mapping[str, Any]) -> None:
    """Refuse keys that nothing reads: Hydra lets ``+typo=3`` in."""
    from .keys import GROUPS

    known = {f.name for f in fields(Base)} | set(GROUPS)
    for key in config:
        if key not in known:
            raise UsageError(f"there is no key {key!r}. {did_you_mean(str(key), known)}")
    for key in config["limit"]:
        if key not in asdict(Limits()):
            raise UsageError(f"there is no key 'limit.{key}'. {did_you_mean(str(key), asdict(Limits()))}")


def one_of(key: str, value: str, known: tuple[str, ...]) -> None:
    """Raise :class:`UsageError` unless ``value`` is one of ``known``."""
    if value not in known:
        raise UsageError(f"{key}={value}: not one of {', '.join(known)}. {did_you_mean(str(value), known)}")


def _sensor(node: Mapping[str, Any], task: Choice) -> Choice:
    """The chosen sensor, which must give what the task takes; none for a task without one."""
    from ..contract.sensors import given_by, needs_a_source, taken_by

    takes = taken_by(task.made)
    if takes == "none":
        return NO_SENSOR
    sensor = Choice.of("sensor", node)
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
            f"sensor {sensor.name} only spoils {gives} that another sensor gives: "
            f"sensor=chain 'sensor.steps=[NAME,{sensor.name}]'"
        )
    return sensor


def _metrics(nodes: Mapping[str, Any], task: Choice) -> tuple[Choice, ...]:
    """The chosen metrics that apply to what the task returns, by name."""
    kind = getattr(task.plugin.cls, "output", "cloud")
    chosen = [Choice.of("metric", node, f"metric.{name}") for name, node in nodes.items()]
    fitting = [m for m in chosen if kind in m.plugin.options.get("outputs", ("mesh", "cloud"))]
    if not fitting:
        names = [m.name for m in registry().all("metric") if kind in m.options.get("outputs", ("mesh", "cloud"))]
        raise UsageError(f"metric: none that is chosen scores a {kind}. Known: {', '.join(names)}")
    return tuple(sorted(fitting, key=lambda m: m.name))


def _cannot_solve(method: Plugin, task: str) -> str:
    solves = [t for t in registry().names("task") if method.solves(t)]
    others = [m.name for m in registry().all("method") if m.solves(task)]
    what = f"it solves {', '.join(solves)}" if solves else "it has no function named after a task"
    return f"method {method.name} does not solve {task}: {what}. Methods that do: {', '.join(others) or 'none'}"


def reference_name(dataset: str, case: str) -> str:
    """The file of a case's reference below ``outputs/references``, for a dataset as results call it.

    With other parameters a dataset has other shapes under the same ids.
    """
    name, _, parameters = dataset.partition("[")
    return f"{name}-{digest(parameters)[:8]}-{case}.ply" if parameters else f"{name}-{case}.ply"


def digest(value: Any) -> str:
    """SHA-256 of a value's canonical JSON."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
