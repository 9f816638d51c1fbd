"""The time of a run: shared between several trainings in a row, and reserved for the surface at the end."""

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

MESHING = 3e-6  # seconds per evaluation for marching cubes, in addition to the field
FEW = 20  # fewer steps can hardly follow a schedule
LAST = 1.0  # seconds for work after the extraction of a surface
PROBES = 4096  # points for measuring the speed of a field
CELLS = 64  # at most, along the longest side of the points' box, for estimating the area of their surface
PER_CELL = 50  # least number of points for each cell on a face of that box; cells are enlarged to reach it


class Stages:
    """The run for each of several trainings: its time and its progress are shares of the whole.

    Parameters
    ----------
    run : Run
    seconds : float
        Of all trainings together, at most; 0 for all that the run's limit allows.
    shares : sequence of numbers that add up to 1
        Time that a training does not use passes to those that follow.
    """

    def __init__(self, run: Run, seconds: float, shares: Sequence[float]):
        self._run, self._shares, self._stage = run, tuple(shares), -1
        self.begin = run.elapsed()
        self._end = self.begin + (seconds or math.inf)
        self.cut = False  # whether the run's limit left less time than that

    def next(self, reserve: float = 0.0) -> float:
        """Begin the next training; returns its seconds, with ``reserve`` of the run's limit set aside."""
        self._stage += 1
        wanted, left = self._end - self.elapsed(), self._run.seconds_left() - reserve
        self.cut = left < wanted < math.inf
        left = min(wanted, left)
        return max(0.1, left * self._shares[self._stage] / sum(self._shares[self._stage :]))

    def elapsed(self) -> float:
        """The run's clock."""
        return self._run.elapsed()

    def progress(self, done: int, total: int) -> None:
        """Report the progress of this training."""
        part = sum(self._shares[: self._stage]) + self._shares[self._stage] * done / total
        self._run.progress(round(1000 * part), 1000)


def seconds_to_extract(field: Field, points: np.ndarray, resolution: int, run: Run) -> float:
    """Estimate generously the time to extract a surface near points (n, 3), by the field's speed: see :mod:`marching`.

    0 for a run without a limit.
    """
    if math.isinf(run.seconds_left()):
        return 0.0
    some = points[:PROBES]
    # A field starts as a sphere of half the radius, and may be slower near its surface than elsewhere. The least of
    # three times counts: the machine may be busy.
    probes = (some, some / np.maximum(2 * np.linalg.norm(some, axis=1, keepdims=True), 1e-9))
    seconds = max(min(timeit.repeat(partial(field.values, x), number=1, repeat=3)) for x in probes)
    per_point = seconds / min(PROBES, len(points)) + MESHING
    extents = np.ptp(points, axis=0)
    shortest = max(extents.min(), extents.max() / 5)  # no side gets more than five times the shortest's samples
    return 2 + 1.5 * per_point * (9 * area_about(points) / shortest**2 * resolution**2 + 2 * 65**3)


def reserve(field: Field, points: np.ndarray, resolution: int, run: Run) -> float:
    """The seconds that a training leaves to the surface: those it will take, but at most half of the time.

    If that is too little, :func:`in_time` makes a coarser surface: a coarse surface of a trained field is better than a
    fine one of an untrained field.
    """
    return min(seconds_to_extract(field, points, resolution, run), run.seconds_left() / 2)


def area_about(points: np.ndarray) -> float:
    """An estimate from above of the area of a surface through points (n, 3): that of their box, or of their cells.

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
    """Note in the row if a training was shorter than requested.

    Parameters
    ----------
    done, steps : int
        Steps that were done, and that were requested.
    given, seconds : float
        The time that the run's limit left to the training, and the requested time, 0 if steps were counted.
    """
    too_short = f"limit.seconds={run.seconds:g} is too short"
    if seconds and given < seconds:
        run.note(f"trained for {given:.3g} of {seconds:g} s: {too_short}")
    elif not seconds and done < steps:
        run.note(f"trained for {done:,} of {steps:,} steps: {too_short}")
    elif seconds and done < FEW:
        run.note(f"trained for only {done} steps, in {seconds:g} s")


def in_time(extract: Callable[[float], Trimesh], run: Run) -> Trimesh:
    """The surface from a function of the available seconds, in the time that is left: a coarser one if necessary.

    A coarser surface in time is better than none; a note reports it.
    """
    mesh = extract(run.seconds_left() - LAST)
    if (coarser := mesh.metadata["coarser"]) > 1:
        run.note(f"the surface has 1/{coarser} of the requested resolution: limit.seconds={run.seconds:g} is too short")
    return mesh
