"""What the families share: endless shapes, kinds in turn, and parameters spread evenly over their range."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from itertools import count
from math import sqrt

from bench import Shape

GOLDEN = (sqrt(5) - 1) / 2


class Family:
    """Base of the families; a subclass defines :meth:`_shape`."""

    def shapes(self, split: str) -> Iterator[Shape]:
        """The endless shapes of a split; ``train`` and ``test`` come from different seeds."""
        for index in count():
            yield self._shape(split, index)

    def _shape(self, split: str, index: int) -> Shape:
        """Shape number ``index`` of a split."""
        raise NotImplementedError


def spread(index: int, start: float = 0.5) -> float:
    """Number ``index`` of the golden-ratio sequence: 0 to 1, and even from the first few on."""
    return (start + index * GOLDEN) % 1


def expect_kind(name: str, value: str, kinds: Collection[str]) -> None:
    """Raise :class:`ValueError` naming a parameter unless it is ``all`` or one of the kinds."""
    if value != "all" and value not in kinds:
        raise ValueError(f"{name}: expected one of all, {', '.join(kinds)}; got {value!r}")


def kind_of(value: str, kinds: Collection[str], index: int) -> str:
    """The chosen kind, or each in turn if that is ``all``."""
    return value if value != "all" else list(kinds)[index % len(kinds)]
