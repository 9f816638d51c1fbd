"""Training data of the networks: points of the surface, points of the space around it, and their distances."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

Distances = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Batch:
    """Points of one step, or of a part of it.

    Attributes
    ----------
    x : (n, 3) tensor
        The first ``on`` of them lie on the surface.
    on : int
    normals : (on, 3) tensor
        Outward unit normals of the surface points.
    distances : (n,) tensor, or None
        True signed distances, if requested.
    total : int
        Points of the whole step: a loss is the sum of its terms over this batch, divided by it.
    """

    x: Tensor
    on: int
    normals: Tensor
    distances: Tensor | None
    total: int

    def chunks(self, size: int) -> Iterator[Batch]:
        """Parts of about ``size`` points, each with its share of surface points; small enough to stay in the cache."""
        parts = max(1, -(-len(self.x) // size))
        surface, space = self.x[: self.on], self.x[self.on :]
        for i in range(parts):
            on, off = _share(len(surface), i, parts), _share(len(space), i, parts)
            distances = None
            if self.distances is not None:
                distances = torch.cat([self.distances[: self.on][on], self.distances[self.on :][off]])
            yield Batch(torch.cat([surface[on], space[off]]), len(surface[on]), self.normals[on], distances, self.total)


def _share(count: int, i: int, parts: int) -> slice:
    return slice(count * i // parts, count * (i + 1) // parts)


class Sampler:
    """Draws batches: half on the surface, with replacement, half uniform in the box [-1, 1]^3.

    Parameters
    ----------
    points, normals : (n, 3) arrays
        In the frame in which the farthest point is at radius 1.
    batch : int
        Surface points of a batch; as many of the space are added (thesis: 4,096 and 4,096).
    generator : torch.Generator
        On the device of the batches.
    """

    def __init__(self, points: np.ndarray, normals: np.ndarray, batch: int, generator: torch.Generator):
        self._generator, self._batch = generator, batch
        device = generator.device
        self._points = torch.as_tensor(np.asarray(points, dtype=np.float32), device=device)
        self._normals = torch.as_tensor(np.asarray(normals, dtype=np.float32), device=device)

    def draw(self) -> Batch:
        """The next batch."""
        device = self._generator.device
        rows = torch.randint(len(self._points), (self._batch,), generator=self._generator, device=device)
        space = torch.rand(self._batch, 3, generator=self._generator, device=device) * 2 - 1
        x = torch.cat([self._points[rows], space])
        return Batch(x, self._batch, self._normals[rows], None, len(x))


class DistanceSampler:
    """Draws batches from points with true distances, sampled beforehand: NGLOD's mixture.

    A fifth of the points is uniform in the box, two fifths lie on the surface (at distance 0 if it is not noisy), two
    fifths near it (Gaussian, ``spread`` of the radius; 0.01 in the released code).

    Parameters
    ----------
    points, normals, batch, generator
        As of :class:`Sampler`; ``2 * batch`` points are drawn, ``2/5`` of them on the surface.
    distances : function of (n, 3) points to (n,) distances
    count : int
        Points that are sampled beforehand (NGLOD: 500,000).
    redraw : int
        They are drawn again after this number of batches, 0 for never (NGLOD: 9,770, which are ten epochs).
    """

    MIXTURE = (2, 2, 1)  # surface, near, uniform

    def __init__(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        batch: int,
        generator: torch.Generator,
        distances: Distances,
        *,
        count: int = 500_000,
        redraw: int = 0,
        spread: float = 0.01,
    ):
        self._generator, self._batch, self._distances = generator, 2 * batch, distances
        self._count, self._redraw, self._spread, self._drawn = count, redraw, spread, 0
        self._points = torch.as_tensor(np.asarray(points, dtype=np.float32), device=generator.device)
        self._normals = torch.as_tensor(np.asarray(normals, dtype=np.float32), device=generator.device)
        self._sample()

    def _sample(self) -> None:
        """Points and their distances, from which batches are drawn."""
        points, generator, count, device = self._points, self._generator, self._count, self._generator.device
        whole = sum(self.MIXTURE)
        rows = torch.randint(len(points), (count * self.MIXTURE[0] // whole,), generator=generator, device=device)
        near = torch.randint(len(points), (count * self.MIXTURE[1] // whole,), generator=generator, device=device)
        offsets = torch.randn(len(near), 3, generator=generator, device=device) * self._spread
        space = torch.rand(count * self.MIXTURE[2] // whole, 3, generator=generator, device=device) * 2 - 1
        self._rows, self._on = rows, points[rows]
        self._off = torch.cat([points[near] + offsets, space])
        known = self._distances(torch.cat([self._on, self._off]).double().cpu().numpy())
        known = torch.as_tensor(np.asarray(known, dtype=np.float32), device=device)
        self._on_distances, self._off_distances = known[: len(rows)], known[len(rows) :]

    def draw(self) -> Batch:
        """The next batch."""
        if self._redraw and self._drawn and self._drawn % self._redraw == 0:
            self._sample()
        self._drawn += 1
        on = self._batch * self.MIXTURE[0] // sum(self.MIXTURE)
        device = self._generator.device
        i = torch.randint(len(self._on), (on,), generator=self._generator, device=device)
        j = torch.randint(len(self._off), (self._batch - on,), generator=self._generator, device=device)
        return Batch(
            torch.cat([self._on[i], self._off[j]]),
            on,
            self._normals[self._rows[i]],
            torch.cat([self._on_distances[i], self._off_distances[j]]),
            self._batch,
        )
