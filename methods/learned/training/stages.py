"""The time of a run: shared between several trainings in a row, and kept for the surface at the end."""

from __future__ import annotations

import math
import timeit
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from bench import Run

from .field import Field

if TYPE_CHECKING:
    from trimesh import Trimesh

MESHING = 3e-6  # seconds per evaluation that the marching cubes take besides
FEW = 20  # steps in which hardly any schedule can be kept to
LAST = 1.0  # seconds for what is done with a surface
PROBES = 4096  # points by which the speed is told
CELLS = 64  # along the longest side of the points' box, by which their surface's area is told, at most
PER_CELL = 50  # at least so many points for each cell on a face of that box, or the cells are larger


class Stages:
    """A run as each of its trainings sees it: the time and the progress are shares of the whole.

    Parameters
    ----------
    run : Run
    seconds : float
        Of all trainings together, at most; 0 for as long as the run's limit allows.
    shares : sequence of numbers that add up to 1
        Time that a training leaves goes to those that follow.
    """

    def __init__(self, run: Run, seconds: float, shares: Sequence[float]):
        self._run, self._shares, self._stage = run, tuple(shares), -1
        self.begin = run.elapsed()
        self._end = self.begin + (seconds or math.inf)
        self.cut = False  # whether the run's limit left less time than that

    def next(self, reserve: float = 0.0) -> float:
        """Begin the next training; the seconds that it may take, with ``reserve`` kept of the run's limit."""
        self._stage += 1
        wanted, left = self._end - self.elapsed(), self._run.seconds_left() - reserve
        self.cut = left < wanted < math.inf
        left = min(wanted, left)
        return max(0.1, left * self._shares[self._stage] / sum(self._shares[self._stage :]))

    def elapsed(self) -> float:
        """The run's clock."""
        return self._run.elapsed()

    def progress(self, done: int, total: int) -> None:
        """So much of this training is done."""
        part = sum(self._shares[: self._stage]) + self._shares[self._stage] * done / total
        self._run.progress(round(1000 * part), 1000)


def seconds_to_extract(field: Field, points: np.ndarray, resolution: int, run: Run) -> float:
    """How long a surface about points (n, 3) will take, generously, by the field's speed there: see :mod:`marching`.

    0 for a run without a limit, which has time for everything.
    """
    if math.isinf(run.seconds_left()):
        return 0.0
    some = points[:PROBES]
    # A field begins as a sphere of half the radius, and may do more near its surface than elsewhere. Of three times the
    # least counts: others may be busy, too.
    probes = (some, some / np.maximum(2 * np.linalg.norm(some, axis=1, keepdims=True), 1e-9))
    seconds = max(min(timeit.repeat(partial(field.values, x), number=1, repeat=3)) for x in probes)
    per_point = seconds / min(PROBES, len(points)) + MESHING
    extents = np.ptp(points, axis=0)
    shortest = max(extents.min(), extents.max() / 5)  # no side gets more than five times the shortest's samples
    return 2 + 1.5 * per_point * (9 * area_about(points) / shortest**2 * resolution**2 + 2 * 65**3)


def reserve(field: Field, points: np.ndarray, resolution: int, run: Run) -> float:
    """The seconds that a training leaves to the surface: what that will take, but half of the time at most.

    Where that is too little, :func:`in_time` makes a coarser surface, which is better of a field that has been trained
    than a fine one of a field that has not.
    """
    return min(seconds_to_extract(field, points, resolution, run), run.seconds_left() / 2)


def area_about(points: np.ndarray) -> float:
    """About the area of a surface through points (n, 3), rather more: that of their box, or of the cells they are in.

    A plane of area A meets A / h^2 cells of side h along the axes, and 3/2 A / h^2 on average of all directions. A
    surface that is folded into its box, like a sponge, has several times the box's area. Fewer points get larger cells,
    so that few are missed, and fewer folds are seen.
    """
    a, b, c = np.ptp(points, axis=0)
    across = min(CELLS, max(4, math.isqrt(len(points) // PER_CELL)))
    side = max(a, b, c) / across
    cells = np.floor((points - points.min(axis=0)) / side).astype(np.int64) @ [1, 2 * across, 4 * across**2]
    return max(2 * (a * b + b * c + c * a), len(np.unique(cells)) * side**2)


def note_shortage(run: Run, done: int, steps: int, given: float, seconds: float) -> None:
    """Tell the reader of the row where a training was shorter than asked for: a method is judged by what it was given.

    Parameters
    ----------
    done, steps : int
        Steps that were done, and that were asked for.
    given, seconds : float
        The time that the run's limit left to the training, and the time that was asked for, 0 if steps were counted.
    """
    too_short = f"limit.seconds={run.seconds:g} is too short"
    if seconds and given < seconds:
        run.note(f"trained for {given:.3g} of {seconds:g} s: {too_short}")
    elif not seconds and done < steps:
        run.note(f"trained for {done:,} of {steps:,} steps: {too_short}")
    elif seconds and done < FEW:
        run.note(f"trained for {done} steps alone, in {seconds:g} s")


def in_time(extract: Callable[[float], Trimesh], run: Run) -> Trimesh:
    """The surface that a function of the seconds there are makes in the time that is left: a coarser one if need be.

    A coarser surface in time is better than none, but the reader of the row should know.
    """
    mesh = extract(run.seconds_left() - LAST)
    if (coarser := mesh.metadata["coarser"]) > 1:
        run.note(f"the surface has 1/{coarser} of the resolution asked for: limit.seconds={run.seconds:g} is too short")
    return mesh
