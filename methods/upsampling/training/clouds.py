"""The training set: evenly spread clouds of one shape at doubling densities, and patches of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..networks.neighbours import gather, nearest

FULL = 32767
FAR = 1e6  # position of the points that pad the smaller clouds of a stack


def pack(pyramids: Iterable[tuple[int, list[np.ndarray]]]) -> dict[str, np.ndarray]:
    """Clouds as few arrays of integers: 3e-5 of their extent is the resolution.

    Parameters
    ----------
    pyramids : iterable of (number of the shape, list of (n, 3) arrays)
        From the input to the densest truth, all lists of one length.

    Returns
    -------
    dict
        ``points`` (total, 3) int16, ``counts`` (pyramids, levels + 1) int64, ``scales`` (pyramids,) float64,
        ``shapes`` (pyramids,) int64.
    """
    points, counts, scales, shapes = [], [], [], []
    for shape, clouds in pyramids:
        scale = max(float(np.abs(cloud).max()) for cloud in clouds) / FULL or 1.0
        points += [np.round(cloud / scale).astype(np.int16) for cloud in clouds]
        counts.append([len(cloud) for cloud in clouds])
        scales.append(scale)
        shapes.append(shape)
    return {
        "points": np.concatenate(points),
        "counts": np.array(counts, dtype=np.int64),
        "scales": np.array(scales),
        "shapes": np.array(shapes, dtype=np.int64),
    }


@dataclass(frozen=True)
class Draw:
    """The settings for drawing patches."""

    noise: float = 0.0  # deviation of the input's points, in the unit of the clouds; cut off at three of it
    scale: float = 0.0  # patches are scaled by a factor from 1 - scale to 1 + scale


class Stack(NamedTuple):
    """Clouds side by side."""

    points: Tensor
    """(3, b, n) tensor: clouds with fewer than n points are padded by points at FAR"""
    counts: np.ndarray
    """(b,) int array: the number of points of each"""

    def seeds(self, rng: np.random.Generator) -> Tensor:
        """A random point of each: (3, b, 1)."""
        chosen = np.array([int(rng.integers(count)) for count in self.counts])
        return self.points[:, torch.arange(len(chosen)), torch.from_numpy(chosen)][..., None]

    def around(self, seeds: Tensor, count: int) -> Tensor:
        """The points nearest the seeds (3, b, 1), in no particular order: (3, b, count).

        Those of a cloud of fewer points are repeated.
        """
        index = nearest(seeds, self.points, count)[:, :, 0]
        if self.counts.min() < count:
            counts = torch.from_numpy(self.counts).to(index.device)[:, None]
            index = index.gather(1, (index >= counts).to(torch.uint8).argsort(dim=1, stable=True))
            index = index.gather(1, torch.arange(count, device=index.device) % counts.clamp_max(count))
        return gather(self.points, index[:, None])[:, :, 0]


class Clouds:
    """The examples of :func:`pack`, on a device.

    Parameters
    ----------
    examples : mapping
    size_of : function
        Gives the points of a patch of a cloud by its number of points.
    device : str
    held_out : bool
        Take the last tenth of the shapes, at least one; otherwise the others (all, if there is only one).
    """

    def __init__(
        self, examples: Mapping[str, np.ndarray], size_of: Callable[[int], int], device: str, held_out: bool = False
    ):
        self._counts = examples["counts"]
        scales = np.repeat(examples["scales"], self._counts.sum(axis=1)).astype(np.float32)
        points = np.ascontiguousarray(examples["points"].T) * scales
        # (3, total + 1): the last one is the padding
        self._points = torch.from_numpy(np.pad(points, ((0, 0), (0, 1)), constant_values=FAR)).to(device)
        self._starts = np.concatenate([[0], self._counts.ravel().cumsum()])[:-1].reshape(self._counts.shape)
        shapes = np.unique(examples["shapes"])
        last = shapes[len(shapes) - max(1, len(shapes) // 10) :]
        mine = np.isin(examples["shapes"], last) == held_out
        self._pyramids = np.flatnonzero(mine) if mine.any() else np.arange(len(mine))
        sizes = np.array([size_of(int(count)) for count in self._counts[self._pyramids, 0]])
        # Patches of one batch have one size.
        self.sizes = [int(size) for size in np.unique(sizes)]
        self._groups = [self._pyramids[sizes == size] for size in self.sizes]

    def batch(
        self, group: int, count: int, levels: list[int], rng: np.random.Generator, draw: Draw, base: int = 0
    ) -> list[Tensor]:
        """Patches around random points of random shapes of a group.

        Parameters
        ----------
        group : int
            Index into ``sizes``, the numbers of points that patches of inputs have.
        count : int
            The number of patches.
        levels : list of int
            The levels of the truths, of size * 2**level points.
        rng : numpy Generator
        draw : Draw
        base : int
            The density that is the input: 0 the sparsest.

        Returns
        -------
        list of (3, count, n) tensors
            The inputs, normalised (up to the factor of ``draw``), and the truths, in the same frames.
        """
        size = self.sizes[group]
        pyramids = rng.choice(self._groups[group], count)
        clouds = self.stack(pyramids, base)
        seeds = clouds.seeds(rng)
        patches = clouds.around(seeds, size)
        truths = [self.stack(pyramids, base + level).around(seeds, size << level) for level in levels]
        if draw.noise:
            noise = np.clip(rng.normal(size=tuple(patches.shape)), -3, 3) * draw.noise
            patches = patches + torch.from_numpy(noise.astype(np.float32)).to(patches)
        centre = patches.mean(2, keepdim=True)
        radius = (patches - centre).square().sum(0).amax(1).clamp_min(1e-12).sqrt()[:, None]
        factor = torch.from_numpy(rng.uniform(1 - draw.scale, 1 + draw.scale, (count, 1)).astype(np.float32))
        turn = torch.from_numpy(rotations(count, rng).astype(np.float32)).to(patches)
        scale = factor.to(patches) / radius

        def move(points: Tensor) -> Tensor:
            return torch.einsum("bij,jbn->ibn", turn, (points - centre) * scale).contiguous()

        return [move(patches), *map(move, truths)]

    def stack(self, pyramids: np.ndarray, level: int) -> Stack:
        """Clouds of one level, side by side: on a GPU, one call serves them all."""
        counts, starts = self._counts[pyramids, level], self._starts[pyramids, level]
        along = np.arange(counts.max())
        rows = np.where(along < counts[:, None], starts[:, None] + along, self._points.shape[1] - 1)
        rows = torch.from_numpy(rows).to(self._points.device)
        points = self._points.index_select(1, rows.reshape(-1)).reshape(3, *rows.shape)
        return Stack(points, counts)


def rotations(count: int, rng: np.random.Generator) -> np.ndarray:
    """Random rotations, all equally likely: (count, 3, 3), from normally distributed quaternions."""
    w, x, y, z = (q := rng.normal(size=(4, count))) / np.linalg.norm(q, axis=0)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
