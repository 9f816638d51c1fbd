"""A dataset that combines others."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, TypeVar

from bench import Shape, ShapePair, build_parts, register

if TYPE_CHECKING:
    from bench import Plugin

Item = TypeVar("Item", Shape, ShapePair)


@register("dataset", requires=("trimesh",))
@dataclass(frozen=True)
class Mixture:
    """Several datasets in turn: one shape of each, then the next of each.

    Shape number k of a family is the same as shape number k of that family alone, with the same mesh, surface, tags and
    attributes; its ``info`` has the name of the family. It keeps its id if that begins with the family's name and a
    hyphen, as in all shipped families; otherwise, or if the id is taken, the name and a hyphen are put before it. A
    family that is named a second time, for instance with other parameters, is called ``cad.2``. A family that has no
    more shapes is left out from then on.

    The mixture has ``pairs`` if one of the families has them, and a state (hashes of your files) if one has.
    """

    # datasets: names, or {name: {parameter: value}}
    of: list[str | dict[str, Any]] = field(default_factory=lambda: ["fbm", "reliefs", "cad"])

    def __post_init__(self) -> None:
        if not self.of:
            raise ValueError("of: expected at least one dataset, for instance [fbm, reliefs, cad]")
        _ = self._families  # reports mistakes here, not when the first shape is made

    @cached_property
    def _parts(self) -> tuple[Any, ...]:
        return build_parts("dataset", self.of, "of")

    @cached_property
    def _families(self) -> dict[str, Any]:
        """The datasets by name."""
        families: dict[str, Any] = {}
        for plugin, dataset in self._parts:
            number = 1 + sum(p is plugin for p, _ in self._parts[: len(families)])
            families[plugin.name if number == 1 else f"{plugin.name}.{number}"] = dataset
        return families

    @property
    def plugins(self) -> tuple[Plugin, ...]:
        """The plugins of the families, and the plugins that these combine."""
        return tuple(plugin for part in self._parts for plugin in part.plugins)

    def shapes(self, split: str) -> Iterator[Shape]:
        """The shapes of a split, one of each family in turn."""
        return _in_turn({name: family.shapes(split) for name, family in self._with("shapes").items()})

    @property
    def pairs(self) -> Callable[[str], Iterator[ShapePair]]:
        """``pairs(split)``: the pairs of a split, one of each family that has some in turn.

        Raises
        ------
        AttributeError
            Where no family has pairs.
        """
        return partial(self._pairs, self._with("pairs"))

    @staticmethod
    def _pairs(families: Mapping[str, Any], split: str) -> Iterator[ShapePair]:
        return _in_turn({name: family.pairs(split) for name, family in families.items()})

    def check(self, split: str) -> None:
        """Run the check of each family that has one."""
        for family in self._families.values():
            check = getattr(family, "check", None)
            if check:
                check(split) if inspect.signature(check).parameters else check()

    @property
    def state(self) -> Callable[[], dict[str, str]]:
        """``state()``: the states that the families report.

        Raises
        ------
        AttributeError
            Where no family has one: then all shapes follow from the parameters, and the cells of a sweep share them.
        """
        return partial(self._state, self._with("state"))

    @staticmethod
    def _state(families: Mapping[str, Any]) -> dict[str, str]:
        return {f"{name}: {key}": value for name, family in families.items() for key, value in family.state().items()}

    def _with(self, function: str) -> dict[str, Any]:
        """The families that have a function."""
        found = {name: family for name, family in self._families.items() if hasattr(family, function)}
        if not found:
            raise AttributeError(f"none of {', '.join(self._families)} has {function}")
        return found


def _in_turn(streams: Mapping[str, Iterator[Item]]) -> Iterator[Item]:
    """One item of each stream in turn, under unique ids; streams that end are left out."""
    streams, taken = dict(streams), set()
    while streams:
        for name, stream in list(streams.items()):
            item = next(stream, None)
            if item is None:
                del streams[name]
                continue
            id = item.id if item.id.startswith(f"{name}-") else f"{name}-{item.id}"
            while id in taken:
                id = f"{name}-{id}"
            taken.add(id)
            yield _renamed(item, id, name)


def _renamed(item: Item, id: str, family: str) -> Item:
    """The item under another id; the info of its shapes, or of both shapes of a pair, names the family."""
    if isinstance(item, ShapePair):
        source, target = (shape.renamed(shape.id, family=family) for shape in (item.source, item.target))
        return replace(item, id=id, source=source, target=target)
    return item.renamed(id, family=family)
