"""The tables of a PLY file: rows of numbers and lists, ASCII or binary, as columns."""

from __future__ import annotations

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
    count: int
    properties: list[Property]


class Ragged(NamedTuple):
    """A column of lists: their sizes (n,), and all values one after the other."""

    sizes: np.ndarray
    values: np.ndarray


Columns = dict[str, "np.ndarray | Ragged"]


class Source:
    """Reads one table after the other; the two formats differ in how a run of equal rows is read."""

    def __init__(self, name: str):
        self.name, self.at = name, 0

    def run(self, element: Element, sizes: list[int], count: int) -> np.ndarray | None:
        """Up to ``count`` rows whose lists have these sizes, as a structured array; None where the file ends."""
        raise NotImplementedError

    def skip(self, element: Element, sizes: list[int], rows: int) -> None:
        """Move past ``rows`` such rows."""
        raise NotImplementedError

    def sizes_of_row(self, element: Element) -> list[int] | None:
        """The sizes of the lists in the row that comes next."""
        raise NotImplementedError

    def left_over(self) -> bool:
        """Whether anything but white space follows the last table."""
        raise NotImplementedError

    def table(self, element: Element) -> Columns:
        """One table, read in runs of rows that are laid out alike (mostly the whole table is one)."""
        parts: list[np.ndarray] = []
        done, guess = 0, element.count
        while done < element.count:
            sizes = self.sizes_of_row(element)
            rows = None if sizes is None else self.run(element, sizes, min(guess, element.count - done))
            if rows is None or not len(rows):
                raise BadInput(
                    f"{self.name}: ends early: its header promises {element.count} of {element.name!r}, "
                    f"{done} are there. The file is cut off; copy or export it again"
                )
            same = np.ones(len(rows), dtype=bool)
            for title, size in zip(_lists(element), sizes or (), strict=True):
                same &= rows[f"size of {title}"] == size
            length = len(rows) if same.all() else int(same.argmin())
            # After a short run the next is probably short too; reading far ahead each time would cost a square.
            guess = 4 * length if length < len(rows) else element.count
            parts.append(rows[:length])
            self.skip(element, sizes or [], length)
            done += length
        return _columns(element, parts)


class BinarySource(Source):
    """A binary body; ``order`` is ``<`` or ``>``."""

    def __init__(self, body: bytes, name: str, order: str):
        super().__init__(name)
        self.body, self.order = body, order

    def sizes_of_row(self, element: Element) -> list[int] | None:
        """The sizes of the lists in the row that comes next; None where the file ends."""
        sizes, at = [], self.at
        for prop in element.properties:
            if prop.length:
                kind = np.dtype(self.order + prop.length)
                if at + kind.itemsize > len(self.body):
                    return None
                size = int(np.frombuffer(self.body, kind, 1, at)[0])
                if size < 0:
                    return None
                sizes.append(size)
                at += kind.itemsize + size * np.dtype(prop.type).itemsize
            else:
                at += np.dtype(prop.type).itemsize
        return sizes if at <= len(self.body) else None

    def run(self, element: Element, sizes: list[int], count: int) -> np.ndarray | None:
        """Up to ``count`` rows whose lists have these sizes; None where the file ends."""
        kind = _row_type(element, sizes, self.order)
        there = (len(self.body) - self.at) // kind.itemsize
        return np.frombuffer(self.body, kind, min(count, there), self.at) if there > 0 else None

    def skip(self, element: Element, sizes: list[int], rows: int) -> None:
        """Move past ``rows`` such rows."""
        self.at += rows * _row_type(element, sizes, self.order).itemsize

    def left_over(self) -> bool:
        """Whether anything but white space follows the last table."""
        return bool(self.body[self.at :].strip())


class AsciiSource(Source):
    """An ASCII body: every number as float64, whatever lines they stand in."""

    def __init__(self, body: bytes, name: str):
        super().__init__(name)
        try:
            self.values = np.array(body.split(), dtype=np.float64)
        except ValueError as error:
            raise BadInput(
                f"{name}: {error}; expected the numbers of a PLY file. The file is cut off or damaged"
            ) from None

    def sizes_of_row(self, element: Element) -> list[int] | None:
        """The sizes of the lists in the row that comes next; None where the file ends."""
        sizes, at = [], self.at
        for prop in element.properties:
            if prop.length:
                if at >= len(self.values) or not 0 <= self.values[at] < 2**31:
                    return None
                sizes.append(int(self.values[at]))
                at += sizes[-1]
            at += 1
        return sizes if at <= len(self.values) else None

    def run(self, element: Element, sizes: list[int], count: int) -> np.ndarray | None:
        """Up to ``count`` rows whose lists have these sizes; None where the file ends."""
        width = len(element.properties) + sum(sizes)
        rows = min(count, (len(self.values) - self.at) // width)
        block = self.values[self.at : self.at + rows * width].reshape(rows, width)
        # Every number of the row as float64: the same fields as in a binary file.
        kind = _row_type(element, sizes, "=", everything="f8")
        return np.ascontiguousarray(block).view(kind)[:, 0] if rows else None

    def skip(self, element: Element, sizes: list[int], rows: int) -> None:
        """Move past ``rows`` such rows."""
        self.at += rows * (len(element.properties) + sum(sizes))

    def left_over(self) -> bool:
        """Whether anything but white space follows the last table."""
        return self.at < len(self.values)


def _lists(element: Element) -> list[str]:
    return [prop.name for prop in element.properties if prop.length]


def _row_type(element: Element, sizes: list[int], order: str, everything: str = "") -> np.dtype:
    fields: list[tuple] = []
    remaining = iter(sizes)
    for prop in element.properties:
        kind = order + (everything or prop.type)
        if prop.length:
            fields.append((f"size of {prop.name}", order + (everything or prop.length)))
            fields.append((prop.name, kind, (next(remaining),)))
        else:
            fields.append((prop.name, kind))
    return np.dtype(fields)


def _columns(element: Element, parts: list[np.ndarray]) -> Columns:
    columns: Columns = {}
    for prop in element.properties:
        if prop.length:
            sizes = [np.full(len(rows), rows[prop.name].shape[1], dtype=np.int64) for rows in parts]
            values = [rows[prop.name].ravel() for rows in parts]
            columns[prop.name] = Ragged(_join(sizes, "i8"), _join(values, prop.type))
        else:
            columns[prop.name] = _join([rows[prop.name] for rows in parts], prop.type)
    return columns


def _join(parts: list[np.ndarray], kind: str) -> np.ndarray:
    kind = "f8" if kind in ("f4", "f8") else kind  # an ASCII file may hold more digits than the type that it names
    with np.errstate(invalid="ignore"):  # NaN as an index becomes one that names no vertex
        return np.concatenate(parts).astype(kind) if parts else np.empty(0, dtype=kind)
