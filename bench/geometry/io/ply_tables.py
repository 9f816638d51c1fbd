"""The tables of a PLY file: rows of numbers and lists, ASCII or binary, as columns."""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...errors import BadInput


class Property(NamedTuple):
    """One column, or a list when ``length`` says how its length is stored."""

    name: str
    type: str
    length: str = ""


class Element(NamedTuple):
    """One table of the file."""

    name: str
    count: int  # type: ignore[assignment]  # hides tuple.count, which nobody calls here
    properties: list[Property]


class Ragged(NamedTuple):
    """A column of lists of whole numbers: their sizes (n,), and all values one after the other, int64."""

    sizes: np.ndarray
    values: np.ndarray


Columns = dict[str, "np.ndarray | Ragged"]


class Source:
    """Reads one table after the other.

    The body of a file is a sequence of cells, ``cells``, of which a number takes one or several: the bytes of a binary
    file, or the numbers of an ASCII file.
    """

    def __init__(self, name: str, cells: np.ndarray, at: int = 0):
        self.name, self.cells, self.at = name, cells, at

    def width(self, kind: str) -> int:
        """How many cells a number of a type takes."""
        raise NotImplementedError

    def reader(self, kind: str) -> Callable[[int], int]:
        """A function that reads the size of a list at a cell: quicker, for one number, than an array."""
        raise NotImplementedError

    def decoded(self, cells: np.ndarray, kind: str) -> np.ndarray:
        """The numbers (n,) of a type in cells (n, width)."""
        raise NotImplementedError

    def left_over(self) -> bool:
        """Whether anything but white space follows the last table."""
        raise NotImplementedError

    def table(self, element: Element) -> Columns:
        """The table that comes next.

        Raises
        ------
        BadInput
            If the file ends before all its rows, or the size of a list cannot be one.
        """
        if not element.count:
            no_list = Ragged(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))
            return {p.name: no_list if p.length else np.empty(0, dtype=p.type) for p in element.properties}
        sizes = self._sizes(element, 1)
        columns = self._alike(element, sizes[:, 0].tolist())
        return columns or self._unlike(element, self._sizes(element, element.count))

    def _sizes(self, element: Element, rows: int) -> np.ndarray:
        """The sizes of the lists in the rows that come next, (lists, rows): each locates the next one."""
        lists = [prop for prop in element.properties if prop.length]
        gaps, leading = [], 0  # cells from the size of a list to that of the next one, besides the list's values
        for prop in element.properties:
            if prop.length:
                gaps.append(self.width(prop.length))
            elif gaps:
                gaps[-1] += self.width(prop.type)
            else:
                leading += self.width(prop.type)
        if not lists:
            return np.empty((0, rows), dtype=np.int64)
        gaps[-1] += leading
        steps = [(self.reader(p.length), gap, self.width(p.type)) for p, gap in zip(lists, gaps, strict=True)]
        sizes: list[int] = []
        at, append = self.at + leading, sizes.append
        try:
            for _ in range(rows):
                for read, gap, width in steps:  # as little as can be: there may be millions of rows
                    size = read(at)
                    append(size)
                    at += gap + width * size
        except (IndexError, struct.error):  # the file ends
            rows = len(sizes) // len(lists)
            del sizes[rows * len(lists) :]
            at = len(self.cells) + leading + 1
        found = np.array(sizes, dtype=np.int64).reshape(rows, len(lists)).T
        if (wrong := (found < 0).any(axis=0)).any():
            raise BadInput(
                f"{self.name}: row {wrong.argmax() + 1} of {element.name!r} has a list whose size is none; expected a "
                "whole number, 0 or more. The file is damaged, export it again"
            )
        if at - leading > len(self.cells):
            ends = self.at + np.cumsum(self._lengths(element, found))
            raise self._ends_early(element, int((ends <= len(self.cells)).sum()))
        return found

    def _lengths(self, element: Element, sizes: np.ndarray) -> np.ndarray:
        """The cells of each row, (rows,), from the sizes of its lists, (lists, rows)."""
        lengths = np.full(sizes.shape[1], sum(self.width(prop.length or prop.type) for prop in element.properties))
        for prop, own in zip((p for p in element.properties if p.length), sizes, strict=True):
            lengths += own * self.width(prop.type)
        return lengths

    def _ends_early(self, element: Element, there: int) -> BadInput:
        return BadInput(
            f"{self.name}: ends early: its header promises {element.count} of {element.name!r}, but the file holds "
            f"{there}. The file is cut off; copy or export it again"
        )

    def _alike(self, element: Element, sizes: list[int]) -> Columns | None:
        """A table whose rows all have lists of these sizes, by one view of the file; None where they have not."""
        remaining = iter(sizes)
        fields: list[tuple[Property, int | None, slice]] = []  # a property, how many values it has, and its cells
        row = 0
        for prop in element.properties:
            if prop.length:
                fields.append((prop, None, slice(row, row := row + self.width(prop.length))))
            count = next(remaining) if prop.length else 1
            fields.append((prop, count, slice(row, row := row + count * self.width(prop.type))))
        there = (len(self.cells) - self.at) // row
        if there < element.count:
            if not sizes:
                raise self._ends_early(element, there)
            return None
        block = self.cells[self.at : self.at + element.count * row].reshape(element.count, row)
        columns: Columns = {}
        for prop, count, place in fields:
            kind = prop.length if count is None else prop.type
            numbers = self.decoded(block[:, place].reshape(-1, self.width(kind)), kind)
            if count is None:
                alike = np.full(element.count, numbers[0].astype(np.int64))
                if not (numbers == alike).all():
                    return None
            else:
                columns[prop.name] = Ragged(alike, as_indices(numbers)) if prop.length else _as_column(numbers, kind)
        self.at += element.count * row
        return columns

    def _unlike(self, element: Element, sizes: np.ndarray) -> Columns:
        """A table whose lists have these sizes, gathered column by column."""
        lengths = self._lengths(element, sizes)
        ends = self.at + np.cumsum(lengths)
        columns = self.rows(element, ends - lengths, ends)
        assert columns is not None  # the sizes were read from the same cells
        self.at = int(ends[-1])
        return columns

    def rows(self, element: Element, starts: np.ndarray, ends: np.ndarray) -> Columns | None:
        """A table whose rows begin at cells ``starts``, (rows,), and have ended at ``ends``.

        None if a row does not fit in there, or the size of a list is none.
        """
        at = starts
        columns: Columns = {}
        for prop in element.properties:
            width = self.width(prop.type)
            after = at + self.width(prop.length or prop.type)
            if (after > ends).any():
                return None
            if prop.length:
                own = as_indices(self._numbers(at, prop.length))
                if ((own < 0) | (after + width * own > ends)).any():
                    return None
                within = np.arange(own.sum()) - np.repeat(np.cumsum(own) - own, own)
                values = self._numbers(np.repeat(after, own) + width * within, prop.type)
                columns[prop.name] = Ragged(own, as_indices(values))
                at = after + width * own
            else:
                columns[prop.name] = _as_column(self._numbers(at, prop.type), prop.type)
                at = after
        return columns

    def _numbers(self, at: np.ndarray, kind: str) -> np.ndarray:
        """The numbers of a type that begin at cells (n,)."""
        return self.decoded(np.stack([self.cells[at + cell] for cell in range(self.width(kind))], axis=1), kind)


class BinarySource(Source):
    """The bytes of a file from ``at`` on; ``order`` is ``<`` or ``>``."""

    def __init__(self, data: bytes, name: str, order: str, at: int = 0):
        super().__init__(name, np.frombuffer(data, dtype=np.uint8), at)
        self.body, self.order = data, order

    def width(self, kind: str) -> int:
        """How many bytes a number of a type takes."""
        return int(kind[1])

    def reader(self, kind: str) -> Callable[[int], int]:
        """A function that reads the size of a list at a byte."""
        if kind == "u1":
            return self.body.__getitem__
        form = struct.Struct(self.order + np.dtype(kind).char)
        return lambda at: form.unpack_from(self.body, at)[0]

    def decoded(self, cells: np.ndarray, kind: str) -> np.ndarray:
        """The numbers (n,) of a type in bytes (n, width)."""
        return np.ascontiguousarray(cells).view(self.order + kind)[:, 0]

    def left_over(self) -> bool:
        """Whether anything but white space follows the last table."""
        return bool(self.body[self.at :].strip())


class NumberSource(Source):
    """The numbers of an ASCII file, (n,) float64, regardless of lines."""

    def __init__(self, numbers: np.ndarray, name: str, at: int = 0):
        super().__init__(name, numbers, at)

    def width(self, kind: str) -> int:
        """A number is a cell."""
        return 1

    def reader(self, kind: str) -> Callable[[int], int]:
        """A function that reads the size of a list; what cannot be one is -1."""
        return memoryview(self._whole.data).__getitem__

    @functools.cached_property
    def _whole(self) -> np.ndarray:
        return as_indices(self.cells)

    def decoded(self, cells: np.ndarray, kind: str) -> np.ndarray:
        """The numbers as they are: the file may hold more digits than the type that it names."""
        return cells[:, 0]

    def left_over(self) -> bool:
        """Whether anything but white space follows the last table."""
        return self.at < len(self.cells)


def _as_column(numbers: np.ndarray, kind: str) -> np.ndarray:
    with np.errstate(invalid="ignore"):  # of NaN among whole numbers
        return numbers.astype("f8" if kind in ("f4", "f8") else kind)


def as_indices(numbers: np.ndarray) -> np.ndarray:
    """Whole numbers, as indices are; what is none becomes -1, which names no vertex."""
    if numbers.dtype.kind == "f":
        numbers = np.where((numbers == np.rint(numbers)) & (np.abs(numbers) < 2**53), numbers, -1)
    return numbers.astype(np.int64)
