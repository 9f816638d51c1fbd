"""The training set: points of the source and of the target of each pair, each in its own box."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ...learned.training.held_out import held_out_rows

if TYPE_CHECKING:
    from bench import Run, TrainingData

FULL = 32767  # the integer of a coordinate of 1
COUNT = 2048  # points of a shape


def pairs_of(data: TrainingData, run: Run, count: int = COUNT) -> dict[str, np.ndarray]:
    """Random points of the sources and the targets, as few arrays.

    Returns
    -------
    dict
        ``points`` (pairs, 2, count, 3) int16, uniform by area, the source of a pair first: in the frame in which the
        box of the shape has its centre at 0 and a longest side of 2, times 32,767. ``extents`` (pairs, 2, 3) float32,
        halves of the sides of those boxes.
    """
    from bench import generator
    from bench.geometry.mesh_surface import MeshSurface
    from bench.geometry.used import used_vertices

    points, extents = [], []
    for number, case in enumerate(data.cases):
        rng = generator(data.seed, case.id, "points")
        for mesh in (case.input["source"], case.reference.mesh):
            used = used_vertices(mesh)
            center, sides = (used.max(axis=0) + used.min(axis=0)) / 2, np.ptp(used, axis=0)
            inside = (MeshSurface(mesh).sample(count, rng)[0] - center) / (sides.max() / 2)
            points.append(np.round(inside.clip(-1, 1) * FULL).astype(np.int16))
            extents.append((sides / sides.max()).astype(np.float32))
        run.progress(number + 1, data.count)
    return {
        "points": np.stack(points).reshape(-1, 2, count, 3),
        "extents": np.stack(extents).reshape(-1, 2, 3),
    }


class Pairs:
    """A part of the examples of :func:`pairs_of`.

    Parameters
    ----------
    examples : mapping
    held_out : bool
        Take the last tenth of the pairs, at least one; otherwise the others (all, if there is only one).
    """

    def __init__(self, examples: Mapping[str, np.ndarray], held_out: bool = False):
        part = held_out_rows(len(examples["points"]), held_out)
        self._points, self._extents = examples["points"][part], examples["extents"][part]

    def draw(
        self, count: int, points: int, scale: float, strangers: float, rng: np.random.Generator, shapes: int = 2
    ) -> np.ndarray:
        """Points of shapes to be deformed to each other, each scaled along its axes and fitted to its box again.

        Parameters
        ----------
        count : int
            Pairs, or triplets.
        points : int
            Of each shape, at most.
        scale : float
            Factors are from 1 - scale to 1 + scale, independent for each shape and axis.
        strangers : float
            Share of the pairs whose second shape is any shape of another pair.
        rng : numpy Generator
        shapes : int
            2, or 3 with a shape of another pair.

        Returns
        -------
        (count, shapes, points, 3) float32 array
        """
        drawn = []
        for _ in range(count):
            pair, side = int(rng.integers(len(self._points))), int(rng.integers(2))
            chosen = [(pair, side), self._other(pair, rng) if rng.random() < strangers else (pair, 1 - side)]
            chosen += [self._other(pair, rng) for _ in range(shapes - 2)]
            drawn.append([self._scaled(*each, points, scale, rng) for each in chosen])
        return np.array(drawn, dtype=np.float32)

    def _other(self, pair: int, rng: np.random.Generator) -> tuple[int, int]:
        """A shape of another pair, or of the same one if there is no other."""
        step = int(rng.integers(1, len(self._points))) if len(self._points) > 1 else 0
        return (pair + step) % len(self._points), int(rng.integers(2))

    def _scaled(self, pair: int, side: int, points: int, scale: float, rng: np.random.Generator) -> np.ndarray:
        stored = self._points[pair, side]
        factors = rng.uniform(1 - scale, 1 + scale, 3)
        factors /= (factors * self._extents[pair, side]).max()
        some = rng.choice(len(stored), min(points, len(stored)), replace=False)
        return stored[some] * (factors / FULL)
