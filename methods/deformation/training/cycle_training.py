"""The training of adaptive layers: triplets of shapes, and cycles through them that end at their start."""

from __future__ import annotations

from functools import reduce
from itertools import permutations
from operator import add
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from ..networks.adaptive_network import AdaptiveNetwork
from .pair_training import PairTraining
from .terms import distance, matches, squared, taken

WAYS = tuple(permutations(range(3), 2))  # the six directed pairs of a triplet
CIRCLES = tuple(permutations(range(3)))


class CycleTraining(PairTraining):
    """Alignment and cycles: see :class:`bench.methods.deformation.cycle_consistent.CycleConsistent`."""

    shapes: ClassVar[int] = 3

    network: AdaptiveNetwork

    def terms(self, shapes: Tensor, rng: np.random.Generator, done: float) -> Tensor:
        """See :meth:`.pair_training.PairTraining.terms`."""
        plan, half = self.plan, shapes.shape[2] // 2
        shapes = shapes[:, :, :half]
        moved = self._deformed(shapes)
        froms, tos = ([way[k] for way in WAYS] for k in (0, 1))
        goals = shapes[:, tos].flatten(0, 1)
        to_goal, from_goal = matches(moved.flatten(0, 1), goals)
        loss = distance(goals, taken(moved.flatten(0, 1), from_goal))
        if plan.two_cycle or plan.three_cycle:
            cycles = Cycles(shapes, moved, to_goal.reshape(*moved.shape[:3]))
            loss = loss + plan.two_cycle * cycles.of_two() + plan.three_cycle * cycles.of_three()
        if done < plan.early:
            loss = loss + self._known(shapes[:, 2], rng)
        return loss

    def _deformed(self, shapes: Tensor) -> Tensor:
        """(b, 3, n, 3) to the six deformations (b, 6, n, 3), each shape encoded once by each encoder."""
        count, together = len(shapes), shapes.flatten(0, 1)
        as_source, as_target = (encoder(together).reshape(count, 3, -1) for encoder in self.network.encoders)
        froms, tos = ([way[k] for way in WAYS] for k in (0, 1))
        code = self.network.matrices(as_source[:, froms].flatten(0, 1), as_target[:, tos].flatten(0, 1))
        return self.network(shapes[:, froms].flatten(0, 1), code).reshape(count, len(WAYS), *shapes.shape[2:])

    def _known(self, points: Tensor, rng: np.random.Generator) -> Tensor:
        """The mean squared error of known deformations: of shapes (b, n, 3) to scaled ones, and back."""
        factors = rng.uniform(1 - self.plan.scale, 1 + self.plan.scale, (len(points), 1, 3)).astype(np.float32)
        other = points * torch.from_numpy(factors).to(points)
        source, target = torch.cat([points, other]), torch.cat([other, points])
        return squared(self.network(source, self.network.encode(source, target)), target)


class Cycles:
    """Cycles through a triplet of shapes: a deformed point continues from the nearest point of the shape it reached.

    Those points are found without a derivative, so that only the last deformation of a cycle is trained by it, as in
    the released code.

    Parameters
    ----------
    shapes : (b, 3, n, 3) tensor
    moved : (b, 6, n, 3) tensor
        The deformations of :data:`WAYS`.
    nearest : (b, 6, n) int64 tensor
        The nearest point of the target shape for each of their points.
    """

    def __init__(self, shapes: Tensor, moved: Tensor, nearest: Tensor):
        self.shapes, self.moved, self.nearest = shapes, moved, nearest

    def of_two(self) -> Tensor:
        """The mean squared distance between start and end of cycles through two shapes."""
        return reduce(add, (self._error(i, j, self._at(i, j)) for i, j in WAYS)) / len(WAYS)

    def of_three(self) -> Tensor:
        """The same for cycles through all three shapes."""
        ways = ((i, k, self._at(j, k).gather(1, self._at(i, j))) for i, j, k in CIRCLES)
        return reduce(add, (self._error(*way) for way in ways)) / len(CIRCLES)

    def _at(self, i: int, j: int) -> Tensor:
        return self.nearest[:, WAYS.index((i, j))]

    def _error(self, i: int, last: int, index: Tensor) -> Tensor:
        """The error of cycles that start at all points of shape i, and are at points (b, n) of the last shape."""
        return squared(taken(self.moved[:, WAYS.index((last, i))], index), self.shapes[:, i])
