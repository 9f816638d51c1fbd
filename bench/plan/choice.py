"""Choices: one plugin with all its parameters, as JSON values."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from ..errors import UsageError
from ..plugins.registry import Plugin, registry
from ..plugins.schema import NAME_KEY, build, parameters, variant


class NotSolved(UsageError):
    """Two choices that do not fit: a sweep leaves such a pair out of its plan and reports it.

    The method has no function for the task, or the sensor's output is not the task's input.
    """


class Resolved:
    """A frozen dataclass whose cached properties stay with the object: a copy, pickled or not, resolves anew."""

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]


@dataclass(frozen=True)
class Choice(Resolved):
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
        """The plugin, and those that its parameters name: the steps of a chain."""
        return (self.plugin, *getattr(self.made, "plugins", ()))

    def solves(self, task: str) -> bool:
        """Whether a method has a function for a task, with these parameters: a chain has those of its last step."""
        return self.plugin.solves(task) and callable(getattr(self.made, task, None))

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
    def of(cls, kind: str, node: Mapping[str, Any] | None, where: str | None = None) -> Choice:
        """From a config node; every parameter is checked and completed."""
        if not isinstance(node, Mapping) or NAME_KEY not in node:
            raise UsageError(f"{where or kind}: choose a {kind} by name, for instance {kind}={_example(kind)}")
        from ..plugins.reads import check_files

        plugin = registry().find(kind, node[NAME_KEY])
        choice = cls(kind, plugin.name, parameters(plugin, build(plugin, node)))
        vars(choice)["plugin"] = plugin  # looked up above
        check_files(choice)
        return choice


def _example(kind: str) -> str:
    names = registry().names(kind)
    return names[0] if names else "NAME"


NO_SENSOR = Choice("sensor", "none")


def digest(value: Any) -> str:
    """SHA-256 of a value's canonical JSON."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
