"""A dataset that is made of others."""

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

    Shape number k of a family is number k of that family alone, with the same mesh, surface, tags and attributes; its
    ``info`` has the name of the family. Its id is its own where that begins with the family's name and a hyphen, as
    those of all shipped families do; otherwise, or where the id is taken, the name and a hyphen are put before it. A
    family that is named a second time, with other parameters for instance, is called ``cad.2``. A family that has no
    more shapes is left out from then on.

    The mixture has ``pairs`` where one of the families has them, and a state (hashes of your files) where one has.
    """

    # datasets: names, or {name: {parameter: value}}
    of: list[str | dict[str, Any]] = field(default_factory=lambda: ["fbm", "reliefs", "cad"])

    def __post_init__(self) -> None:
        if not self.of:
            raise ValueError("of: expected at least one dataset, for instance [fbm, reliefs, cad]")
        _ = self._families  # mistakes are refused here, not when the first shape is made

    @cached_property
    def _parts(self) -> tuple[Any, ...]:
        return build_parts("dataset", self.of, "of")

    @cached_property
    def _families(self) -> dict[str, Any]:
        """The datasets by what they are called."""
        families: dict[str, Any] = {}
        for plugin, dataset in self._parts:
            number = 1 + sum(p is plugin for p, _ in self._parts[: len(families)])
            families[plugin.name if number == 1 else f"{plugin.name}.{number}"] = dataset
        return families

    @property
    def plugins(self) -> tuple[Plugin, ...]:
        """The plugins of the families, and those that they are made of."""
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
        """Let each family that has a check say what is wrong with it."""
        for family in self._families.values():
            check = getattr(family, "check", None)
            if check:
                check(split) if inspect.signature(check).parameters else check()

    @property
    def state(self) -> Callable[[], dict[str, str]]:
        """``state()``: what the families say of their own state.

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
    """One item of each stream in turn, under ids that no two share; what ends is left out."""
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
            yield _called(item, id, name)


def _called(item: Item, id: str, family: str) -> Item:
    """The item under another id; the shapes of a pair say the family too."""
    if isinstance(item, ShapePair):
        source, target = (shape.renamed(shape.id, family=family) for shape in (item.source, item.target))
        return replace(item, id=id, source=source, target=target)
    return item.renamed(id, family=family)
