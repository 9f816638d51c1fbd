"""Pairs of clouds of one shape, the second with several times as many points, and patches of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..networks.neighbours import gather
from .clouds import Clouds, rotations

if TYPE_CHECKING:
    from bench import Case, Run, TrainingData

RATIO = 4


def pairs_of(
    data: TrainingData, run: Run, bases: tuple[int, ...], scans: tuple[str, ...], times: int = RATIO
) -> Iterator[tuple[Case, list[list[np.ndarray]]]]:
    """The pairs of clouds of each case.

    Parameters
    ----------
    data : TrainingData
    run : Run
        Receives the progress.
    bases : tuple of int
        Points of the inputs, evenly spread on the exact surface, as the truths are; 0 for the cloud of the sensor.
    scans : tuple of str
        Instead of them, sensors that make ``times`` as many points each: the truth of one is the input of the next.
    times : int
    """
    from bench import generator
    from bench.geometry.poisson_disk import sample_poisson_disk

    for number, case in enumerate(data.cases):
        if scans:
            # The same generator for all densities, so that a scanner has the same position.
            clouds = [data.sense(case, scan, generator(data.seed, case.id)).points for scan in scans]
            yield case, [[sparse, dense] for sparse, dense in zip(clouds[:-1], clouds[1:], strict=True)]
        else:
            sensed = case.input["cloud"].points
            counts = {base or len(sensed) for base in bases}
            even = {
                count: sample_poisson_disk(case.reference, count, generator(data.seed, case.id, f"{count} points"))[0]
                for count in sorted({base for base in bases if base} | {times * count for count in counts})
            }
            yield case, [[even[base] if base else sensed, even[times * (base or len(sensed))]] for base in bases]
        run.progress(number + 1, data.count)


@dataclass(frozen=True)
class Augmentation:
    """The augmentation of a patch; there is always a random rotation, all of them equally likely."""

    noise: float = 0.0  # deviation of the input's points, in the unit of the clouds; cut off at three of it
    jitter: float = 0.0  # the same in radii of the patch, cut off at two of it
    scale: float = 0.0  # patches are scaled by a factor from 1 - scale to 1 + scale
    shift: float = 0.0  # and moved by up to this along each axis
    subset: bool = False  # the input is an uneven random part of the truth, as PU-Net was trained


class Patches(NamedTuple):
    """A batch of pairs of patches, in frames of their own."""

    inputs: Tensor
    """(3, b, n) tensor, nearest the seed first: centroid at 0 and farthest point at 1 before scaling and jitter"""
    truths: Tensor
    """(3, b, times * n) tensor, in the same frames"""
    scales: Tensor
    """(b,) tensor: the factors of the augmentation"""
    seeds: Tensor
    """(3, b, 1) tensor: the points around which the patches were cut, in the unit of the clouds"""
    pyramids: np.ndarray
    """(b,) int array: the pair of clouds"""
    frame: tuple[Tensor, Tensor, Tensor]
    """(b, 3, 3) rotations, (3, b, 1) centres, (b, 1) factors, and shifts: see :meth:`move`"""
    shifts: Tensor
    """(3, b, 1) tensor"""

    def move(self, points: Tensor) -> Tensor:
        """Points (3, b, m) of the clouds, in the frames of the patches."""
        turn, centre, factor = self.frame
        return torch.einsum("bij,jbn->ibn", turn, (points - centre) * factor) + self.shifts


class Pairs(Clouds):
    """Patches of pairs of clouds from :func:`.clouds.pack`; see there for the parameters.

    The second cloud has ``times`` as many points.
    """

    def __init__(
        self,
        examples: Mapping[str, np.ndarray],
        size_of: Callable[[int], int],
        device: str,
        held_out: bool = False,
        times: int = RATIO,
    ):
        super().__init__(examples, size_of, device, held_out)
        self.times = times

    def draw(self, count: int, rng: np.random.Generator, how: Augmentation) -> Patches:
        """Patches around random points of random shapes; all of one size.

        Parameters
        ----------
        count : int
        rng : numpy Generator
        how : Augmentation
        """
        weights = np.array([len(group) for group in self._groups])
        group = int(rng.choice(len(weights), p=weights / weights.sum()))
        size = self.sizes[group]
        pyramids = rng.choice(self._groups[group], count)
        clouds = self.stack(pyramids, 0)
        seeds = clouds.seeds(rng)
        truths = _sorted(self.stack(pyramids, 1).around(seeds, self.times * size), seeds)
        if how.subset:  # the points are already sorted
            parts = np.stack([uneven(self.times * size, size, rng) for _ in pyramids])
            inputs = gather(truths, torch.from_numpy(parts).to(truths.device)[:, None])[:, :, 0]
        else:
            inputs = _sorted(clouds.around(seeds, size), seeds)
        return _framed(inputs, truths, seeds, pyramids, rng, how)


def _sorted(points: Tensor, seeds: Tensor) -> Tensor:
    """Points (3, b, n), those nearest their seeds (3, b, 1) first."""
    order = (points - seeds).square().sum(0).argsort(dim=1, stable=True)
    return gather(points, order[:, None])[:, :, 0]


def _framed(
    inputs: Tensor, truths: Tensor, seeds: Tensor, pyramids: np.ndarray, rng: np.random.Generator, how: Augmentation
) -> Patches:
    count = len(pyramids)

    def normal(cut: float) -> Tensor:
        return _tensor(np.clip(rng.normal(size=tuple(inputs.shape)), -cut, cut), inputs)

    if how.noise:
        inputs = inputs + normal(3.0) * how.noise
    centre = inputs.mean(2, keepdim=True)
    radius = (inputs - centre).square().sum(0).amax(1).clamp_min(1e-12).sqrt()[:, None]
    scale = _tensor(rng.uniform(1 - how.scale, 1 + how.scale, count), inputs)
    shift = _tensor(rng.uniform(-how.shift, how.shift, (3, count, 1)), inputs)
    frame = (_tensor(rotations(count, rng), inputs), centre, scale[:, None] / radius)
    patches = Patches(inputs, truths, scale, seeds, pyramids, frame, shift)
    inputs = patches.move(inputs)
    if how.jitter:
        some = _tensor(rng.random((count, 1)) < 0.5, inputs)
        inputs = inputs + normal(2.0) * how.jitter * some
    return patches._replace(inputs=inputs.contiguous(), truths=patches.move(truths).contiguous())


def uneven(total: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """``count`` different numbers from 0 to ``total - 1``, dense around a random one: (count,) int array.

    As released with PU-Net: numbers are normally distributed with deviation 0.3 of the range around one that is
    uniform from 0.1 to 0.9 of it. In order of distance to the seed of a patch, this thins the middle or the border.
    """
    centre = rng.uniform(0.1, 0.9)
    weight = np.exp(-0.5 * ((np.arange(total) / total - centre) / 0.3) ** 2)
    return np.sort(rng.choice(total, count, replace=False, p=weight / weight.sum()))


def _tensor(array: np.ndarray, like: Tensor) -> Tensor:
    return torch.from_numpy(np.asarray(array, dtype=np.float32)).to(like)


def held_out(examples: Mapping[str, np.ndarray], points: int, device: str, times: int = RATIO) -> tuple[Pairs, Pairs]:
    """The pairs for training, and those of held-out shapes; patches of at most ``points`` points."""

    def size(count: int) -> int:
        return min(points, count)

    return Pairs(examples, size, device, times=times), Pairs(examples, size, device, held_out=True, times=times)
