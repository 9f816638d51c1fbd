"""Plugins that are made of others: the steps of a chain of sensors, the families of a mixture of datasets.

Such a plugin has a property ``plugins``, which names its parts, so that fingerprints cover their sources too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ..errors import UsageError
from .registry import Plugin, registry
from .schema import build


class Part(NamedTuple):
    """One part: what it is, and the object."""

    plugin: Plugin
    made: Any

    @property
    def plugins(self) -> tuple[Plugin, ...]:
        """The plugin, and those that it is made of itself."""
        return (self.plugin, *getattr(self.made, "plugins", ()))


def build_parts(kind: str, items: Sequence[str | Mapping[str, Any]], where: str) -> tuple[Part, ...]:
    """The plugins that are named by ``items``, with their parameters checked.

    Parameters
    ----------
    kind : of plugin, such as ``"sensor"``
    items : sequence
        Each a name, or a mapping of one name to its parameters: ``{"gaussian": {"sigma": 0.01}}``.
    where : the parameter that holds the items, for messages

    Raises
    ------
    ValueError
        Naming the item, what was expected and, for a wrong name, the nearest right one.
    """
    built = []
    for number, item in enumerate(items, 1):
        if isinstance(item, str):
            name, values = item, None
        elif isinstance(item, Mapping) and len(item) == 1:
            name, values = next(iter(item.items()))
        else:
            raise ValueError(f"{where}: number {number} is {item!r}; expected a name or {{name: {{parameter: value}}}}")
        if values is not None and not isinstance(values, Mapping):
            raise ValueError(f"{where}: the parameters of {name} are {values!r}; expected {{parameter: value, ...}}")
        try:
            plugin = registry().find(kind, name)
            built.append(Part(plugin, build(plugin, values or {})))
        except UsageError as error:
            raise ValueError(f"{where}: number {number}: {error}") from error
    return tuple(built)
