"""Lattices of any size, numbered nodes and cells, and the band of cells in which a field is known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

BASE = 32  # cells along the shortest side of a lattice at its coarsest level, which is evaluated everywhere
CHUNK = 1 << 16  # cells at a time
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])


@dataclass(frozen=True, eq=False)
class Lattice:
    """A rotated cubical lattice; ``cells`` is a multiple of ``2 ** levels`` along each axis."""

    origin: np.ndarray  # (3,)
    axes: np.ndarray  # (3, 3), a unit vector in each row
    spacing: float
    cells: tuple[int, int, int]
    levels: int  # how often the spacing is halved

    @classmethod
    def over(
        cls,
        low: np.ndarray,
        high: np.ndarray,
        axes: np.ndarray,
        samples: int,
        max_aspect: float = np.inf,
        base: int = BASE,
    ) -> Lattice:
        """The lattice about a box, given in the coordinates of ``axes``, with ``samples`` along its shortest side.

        Its coarsest level has about ``base`` cells along that side.
        """
        extent = high - low
        spacing = float(max(extent.min(), extent.max() / max_aspect)) / (samples - 1)
        levels = max(0, round(np.log2((samples - 1) / base)))
        # Whole blocks: the lattice extends a little beyond the box, which costs nothing in a narrow band.
        cells = np.ceil(extent / (spacing * 2**levels) - 1e-6).astype(int) * 2**levels
        origin = ((low + high - cells * spacing) / 2) @ axes
        return cls(origin, axes, spacing, tuple(cells.tolist()), levels)

    def level(self, number: int) -> Level:
        """Every ``2 ** number``-th point."""
        a, b, c = ((n >> number) + 1 for n in self.cells)
        return Level(self.origin, self.axes, self.spacing * 2**number, (a, b, c))


class Level(NamedTuple):
    """One level of a lattice. Nodes are numbered along the last axis first; a cell has the number of its first node."""

    origin: np.ndarray
    axes: np.ndarray
    spacing: float
    shape: tuple[int, int, int]  # nodes along each axis

    @property
    def strides(self) -> np.ndarray:
        """From one node's number to the next, along each axis: (3,)."""
        return np.array([self.shape[1] * self.shape[2], self.shape[2], 1])

    def coordinates(self, nodes: np.ndarray) -> np.ndarray:
        """The integer coordinates of nodes: (3, n)."""
        return np.stack(np.unravel_index(nodes, self.shape))

    def points(self, nodes: np.ndarray, shift: np.ndarray | float = 0.0) -> np.ndarray:
        """The positions of nodes, moved by ``shift`` spacings (a number or (3, n)) along the axes: (n, 3)."""
        x, y, z = self.spacing * (self.coordinates(nodes) + shift)
        # Not a matrix product: the position of a node must be the same in every batch, to the last digit.
        return np.stack([x * a + y * b + z * c + o for a, b, c, o in zip(*self.axes, self.origin, strict=True)], axis=1)

    def touching(self, cells: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Those of the cells whose circumscribed ball touches a box of space."""
        middle = self.points(cells, 0.5)
        outside = np.maximum(np.abs(middle - (low + high) / 2) - (high - low) / 2, 0)
        return cells[np.einsum("ni,ni->n", outside, outside) <= 0.75 * self.spacing**2]


@dataclass(frozen=True, eq=False)
class Band:
    """Cells of a level that may hold surface, with the values at their corners; all numbers ascend."""

    level: Level
    cells: np.ndarray  # (c,)
    nodes: np.ndarray  # (n,), the corners of the cells
    values: np.ndarray  # (n,)

    def corners(self, cells: np.ndarray) -> np.ndarray:
        """For each corner and each of the cells the place in ``nodes``: (8, c)."""
        places = np.empty((8, len(cells)), dtype=np.int64)
        for j, (x, y, z) in enumerate(CORNERS):
            if not z:
                places[j] = places_of(self.nodes, cells + self.level.strides @ (x, y, 0))
                places[j + 4] = places[j] + 1  # both are nodes, and their numbers follow each other
        return places

    @cached_property
    def crossed(self) -> tuple[np.ndarray, np.ndarray]:
        """The cells whose corners have both signs (c,), and their signs: bit j for a negative corner j."""
        cells, signs = [self.cells[:0]], [np.empty(0, dtype=np.uint8)]
        for part in chunks(self.cells):
            sign = np.packbits(self.values[self.corners(part)] < 0, axis=0, bitorder="little")[0]
            mixed = (sign != 0) & (sign != 255)
            cells.append(part[mixed])
            signs.append(sign[mixed])
        return np.concatenate(cells), np.concatenate(signs)


# -- ascending numbers -------------------------------------------------------------------------------------------


def chunks(numbers: np.ndarray) -> list[np.ndarray]:
    """Parts that fit the cache, in order."""
    return [numbers[start : start + CHUNK] for start in range(0, len(numbers), CHUNK)]


def numbers_of(level: Level, coordinates: np.ndarray) -> np.ndarray:
    """The numbers of the nodes at integer coordinates (3, n)."""
    return level.strides @ coordinates


def places_of(numbers: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """The places of the ``wanted`` (w,) in ``numbers``, both ascending; arbitrary for missing ones: (w,)."""
    places = []
    for part in chunks(wanted):
        first, span = part[0], part[-1] + 1 - part[0]
        begin, end = np.searchsorted(numbers, (first, first + span))
        if span < 32 * len(part):  # the usual case: a lookup in a table, five times as fast as a search
            table = np.zeros(span, dtype=np.int64)
            table[numbers[begin:end] - first] = np.arange(begin, end)
            places.append(table[part - first])
        else:
            places.append(np.minimum(begin + np.searchsorted(numbers[begin:end], part), len(numbers) - 1))
    return np.concatenate(places) if places else np.empty(0, dtype=np.int64)


def union(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The union of two ascending arrays; a stable sort merges them in linear time."""
    both = np.concatenate([a, b])
    both.sort(kind="stable")
    return both[np.concatenate([[True], both[1:] != both[:-1]])] if len(both) else both
