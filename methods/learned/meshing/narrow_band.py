"""The cells of a lattice that may hold surface: found coarse to fine, proven empty by slopes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from bench import InvalidOutput

from .lattice import CORNERS, Band, Lattice, Level, chunks, numbers_of, places_of, union
from .triangles import EDGE_AXES, EDGES

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

SLACK = 1.5  # factor by which a field may be steeper between lattice points than its values there show
ROOM = 1.5  # times the estimated time of the last level is reserved: it is triangulated too; the machine may be busy
TYPICAL = 0.5  # share of a field's variation near its zeros that lies in cells of at most its typical slope
# From corner j of a cube of side 1 to the farthest point of its half-sized child at corner i.
REACH = np.sqrt(np.where(CORNERS[:, None] == CORNERS, 0.25, 1.0).sum(axis=-1)) * (1 + 1e-9)


class Sampler:
    """A field that is evaluated in batches, never outside of the domain; it counts the evaluations.

    Outside of the domain it has the value of the nearest point inside: this is no steeper than the field.

    Attributes
    ----------
    count : int, points evaluated
    least, largest : float, the range of all values
    """

    def __init__(
        self,
        field: Callable[[np.ndarray], np.ndarray],
        domain: tuple[ArrayLike, ArrayLike] = (-1.0, 1.0),
        batch: int = 65_536,
        on_progress: Callable[[int, int], None] | None = None,
    ):
        self.low, self.high = (np.broadcast_to(np.asarray(c, dtype=np.float64), 3) for c in domain)
        if not (self.low < self.high).all() or not np.isfinite([self.low, self.high]).all():
            raise ValueError(f"domain: expected a lower and a higher corner, got {domain}")
        if batch < 1:
            raise ValueError(f"batch: expected at least 1, got {batch}")
        self.count, self.least, self.largest = 0, np.inf, -np.inf
        self._field, self._batch, self._on_progress, self._done = field, batch, on_progress, 0

    def values(self, level: Level, nodes: np.ndarray, span: tuple[float, float]) -> np.ndarray:
        """The field at nodes (n,) of a level: an (n,) float64 array; ``span`` is its part of the progress."""
        values = np.empty(len(nodes))
        for start in range(0, len(nodes), self._batch):
            points = np.clip(level.points(nodes[start : start + self._batch]), self.low, self.high)
            part = np.asarray(self._field(points))
            if part.shape != (len(points),):
                raise ValueError(f"field: expected values ({len(points)},) for {len(points)} points, got {part.shape}")
            if not np.isfinite(part).all():
                raise InvalidOutput(
                    f"the field is not finite at {(~np.isfinite(part)).sum()} of {len(points)} points, "
                    f"for instance at {points[~np.isfinite(part)][0].round(6).tolist()}"
                )
            values[start : start + len(points)] = part
            self.count += len(points)
            self.least, self.largest = min(self.least, float(part.min())), max(self.largest, float(part.max()))
            self.report(span[0] + (span[1] - span[0]) * (start + len(points)) / len(nodes))
        return values

    def report(self, done: float) -> None:
        """Report the fraction of the work that is done."""
        if self._on_progress and round(100 * done) > self._done:
            self._done = round(100 * done)
            self._on_progress(self._done, 100)

    def no_crossing(self) -> InvalidOutput:
        """The error of a field without a surface."""
        if self.least >= 0 or self.largest < 0:
            sign = "negative" if self.largest < 0 else "positive" if self.least > 0 else "positive or zero"
            found = f"all {self.count:,} values are {sign}"
        else:
            found = f"{self.count:,} values from {self.least:.3g} to {self.largest:.3g}, no neighbours with two signs"
        return InvalidOutput(f"the field has no zero crossing in the domain: {found}")


def finest_band(
    sampler: Sampler,
    lattice: Lattice,
    lipschitz: float | None,
    max_cells: int,
    span: tuple[float, float],
    until: float = math.inf,
) -> tuple[Band, float]:
    """The band at the spacing of the lattice, refined through all coarser levels, and the least bound of slopes in use.

    Once there is a surface, a level that would not be finished by the time ``until``, on the clock of
    :func:`time.perf_counter`, is left out with all finer ones. The time of a level is estimated from the time for each
    cell of the one before.
    """
    level = lattice.level(lattice.levels)
    cells = numbers_of(level, np.indices([n - 1 for n in level.shape]).reshape(3, -1))
    nodes, values = np.empty(0, dtype=np.int64), np.empty(0)
    bound: float | None = None
    share, begin = (span[1] - span[0]) * 3 / (4 ** (lattice.levels + 1) - 1), span[0]
    for step in range(lattice.levels + 1):
        end = begin + share * 4**step  # each level has about four times as many cells
        started = time.perf_counter()
        band = _evaluate(sampler, level, cells, nodes, values, max_cells, (begin, end))
        bound = _slope_bound(band, lipschitz) if bound is None else bound
        if step == lattice.levels:
            break
        level, cells = children_of(band, bound)
        if not len(cells):
            raise sampler.no_crossing()
        seconds = (time.perf_counter() - started) * len(cells) / len(band.cells)
        if time.perf_counter() + ROOM * seconds > until and len(band.crossed[0]):
            break
        # Corners of cells have even coordinates in the next level, where they are corners again.
        nodes, values = numbers_of(level, 2 * band.level.coordinates(band.nodes)), band.values
        begin = end
    assert bound is not None  # of the coarsest level, which always exists
    return band, bound


def _evaluate(
    sampler: Sampler,
    level: Level,
    cells: np.ndarray,
    nodes: np.ndarray,
    values: np.ndarray,
    max_cells: int,
    span: tuple[float, float],
) -> Band:
    """The band of ``cells`` and of those into which its surface continues, given the values at some nodes."""
    while True:
        cells = level.touching(cells, sampler.low, sampler.high)
        if len(cells) > max_cells:
            raise InvalidOutput(
                f"the field is near zero nearly everywhere: more than {max_cells:,} cells of size {level.spacing:.3g} "
                "may contain surface; it is not a distance to a surface, or the resolution is too high for it"
            )
        corners = cells
        for stride in level.strides:
            corners = union(corners, corners + stride)
        # Not all known nodes are still corners: those of dropped cells are removed.
        place = places_of(corners, nodes)
        still = corners[place] == nodes
        found, new = np.empty(len(corners)), np.ones(len(corners), dtype=bool)
        found[place[still]], new[place[still]] = values[still], False
        found[new] = sampler.values(level, corners[new], span)
        band = Band(level, cells, corners, found)
        lost = _lost_neighbours(sampler, band)
        if not len(lost):
            return band
        cells, nodes, values = union(cells, lost), corners, found


def _lost_neighbours(sampler: Sampler, band: Band) -> np.ndarray:
    """The cells that are not in the band, but share a face with both signs with one that is."""
    level, (crossed, signs), lost = band.level, band.crossed, [band.cells[:0]]
    coordinates = level.coordinates(crossed)
    for axis in range(3):
        for side in (0, 1):
            face = int(np.packbits(CORNERS[:, axis] == side, bitorder="little")[0])
            leaves = (signs & face != 0) & (signs & face != face)
            leaves &= coordinates[axis] != side * (level.shape[axis] - 2)
            neighbours = crossed[leaves] + (2 * side - 1) * level.strides[axis]
            lost.append(neighbours[band.cells[places_of(band.cells, neighbours)] != neighbours])
    return level.touching(np.unique(np.concatenate(lost)), sampler.low, sampler.high)


def _slope_bound(band: Band, lipschitz: float | None) -> float:
    """The least slope to assume for the field, from a band that covers the domain.

    It is the typical slope of cells near a zero, as their corners show it; elsewhere it does not matter. Slopes are
    weighted by themselves, so flat parts (a truncated distance) and a few jumps do not count.
    """
    if lipschitz is not None:
        return lipschitz
    slopes, near = [], []
    for cells in chunks(band.cells):
        values = band.values[band.corners(cells)]
        slopes.append(_slopes(values, band.level.spacing))
        near.append(np.abs(values).min(axis=0) <= 2 * band.level.spacing * slopes[-1])
    slopes, near = np.concatenate(slopes), np.concatenate(near)
    slopes = np.sort(slopes[near] if near.any() else slopes)
    ascent = np.cumsum(slopes)
    return SLACK * float(slopes[np.searchsorted(ascent, TYPICAL * ascent[-1])])


def _slopes(values: np.ndarray, spacing: float) -> np.ndarray:
    """The slope in cells, from the steepest of the four edges along each axis: (c,) from values (8, c)."""
    square = np.zeros(values.shape[1])
    for axis in range(3):
        first, second = EDGES[axis == EDGE_AXES].T
        square += np.abs(values[first] - values[second]).max(axis=0) ** 2
    return np.sqrt(square) / spacing


def children_of(band: Band, bound: float) -> tuple[Level, np.ndarray]:
    """The next level, and the half-sized cells there that may hold surface."""
    spacing = band.level.spacing
    a, b, c = (2 * n - 1 for n in band.level.shape)
    level = band.level._replace(spacing=spacing / 2, shape=(a, b, c))
    kept = []
    for cells in chunks(band.cells):
        values = band.values[band.corners(cells)]
        first = numbers_of(level, 2 * band.level.coordinates(cells))
        negative = values < 0
        mixed = negative.any(axis=0) & ~negative.all(axis=0)
        # How far the cell is empty about each corner, in spacings; a cell without slope keeps nothing, or all if L = 0.
        bound_here = np.maximum(bound, SLACK * _slopes(values, spacing))
        values = np.abs(values)
        for corner, reach in zip(CORNERS, REACH, strict=True):
            keep = mixed | (values <= bound_here * spacing * reach[:, None]).all(axis=0)
            kept.append(first[keep] + level.strides @ corner)
    return level, np.sort(np.concatenate(kept))
