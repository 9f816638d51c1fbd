"""The training set: evenly spread clouds of exact surfaces with normals, and noisy patches of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from ..networks.nearby import nearest
from ..patches.frames import principal_frames, random_turns

if TYPE_CHECKING:
    from bench import Run, TrainingData

FULL, UNIT = 32767, 127  # the largest integers of a coordinate of a point, and of a normal
WIDE = 2.0  # times the points of a patch get noise, before the nearest of them are taken
AROUND = 1.3  # times the exact points of a patch are stored around it
LARGEST = 0.18  # largest noise, relative to the radius of a patch: with more, points would come from farther away
REGION = 2.5  # radii of balls that a region has
DISC = 1.3  # for the radius of the disc of a random sample: the k-th nearest sample is sqrt(k) / 1.3 of it away


def clouds_of(data: TrainingData, run: Run, counts: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Clouds of the given numbers of points of each shape, sparsest first, as few arrays of integers.

    The densest is random, each of the others is an evenly spread part of the next.

    Returns
    -------
    dict
        ``points`` (total, 3) int16 and ``normals`` (total, 3) int8, shape by shape and count by count; ``scales``
        (shapes,) float64, the unit of the points; ``counts`` (levels,) int64.
    """
    from bench import generator
    from bench.geometry.poisson_disk import eliminate

    points, normals, scales = [], [], []
    for number, case in enumerate(data.cases):
        clouds = [case.reference.surface.sample(counts[-1], generator(data.seed, case.id, "clouds"))]
        for count in counts[-2::-1]:
            clouds.insert(0, eliminate(*clouds[0], case.reference.mesh, count))
        scale = max(float(np.abs(cloud).max()) for cloud, _ in clouds) / FULL
        points += [np.round(cloud / scale).astype(np.int16) for cloud, _ in clouds]
        normals += [np.round(normal * UNIT).astype(np.int8) for _, normal in clouds]
        scales.append(scale)
        run.progress(number + 1, data.count)
    return {
        "points": np.concatenate(points),
        "normals": np.concatenate(normals),
        "scales": np.array(scales),
        "counts": np.array(counts, dtype=np.int64),
    }


@dataclass(frozen=True, eq=False)
class Patch:
    """Noisy points around a seed, and the surface there; all in the unit of the clouds, relative to the seed."""

    noisy: Tensor
    """(n, 3) tensor: the points around the seed; in a patch, the seed and those nearest to it, the nearest first"""
    surface: Tensor
    """(m, 3) tensor: exact points of the patch and around it"""
    normals: Tensor
    """(m, 3) tensor: the normals of these points"""
    disc: float
    """The radius of the disc that each of them represents"""

    def nearest_surface(self, places: Tensor) -> Tensor:
        """The points of the surface nearest to places (k, 3): those of the discs around the exact points."""
        return on_discs(places[None], self.surface[None], self.normals[None], self.disc)[0]


def on_discs(places: Tensor, points: Tensor, normals: Tensor, radius: float) -> Tensor:
    """The point nearest each place, of the disc around the nearest of the points.

    The nearest of the points itself would be off by half a spacing along the surface, which hides small noise. A plane
    would be right near it, but wrong beyond edges.

    Parameters
    ----------
    places : (b, k, 3) tensor
    points, normals : (b, m, 3) tensors
    radius : float

    Returns
    -------
    (b, k, 3) tensor
    """
    index = nearest(places, points, 1).expand(-1, -1, 3)
    point, normal = points.gather(1, index), normals.gather(1, index)
    offset = places - point
    along = offset - (offset * normal).sum(2, keepdim=True) * normal
    length = along.norm(dim=2, keepdim=True).clamp_min(1e-12)
    return point + along * (radius / length).clamp_max(1.0)


class Clouds:
    """The examples of :func:`clouds_of`, on the CPU.

    Parameters
    ----------
    examples : mapping
    held_out : bool
        Take the last tenth of the shapes, at least one; otherwise the others (all, if there is only one).
    """

    def __init__(self, examples: Mapping[str, np.ndarray], held_out: bool = False):
        self._points, self._normals = examples["points"], examples["normals"]
        self._scales, self.counts = examples["scales"], [int(count) for count in examples["counts"]]
        shapes = len(self._scales)
        last = max(1, shapes // 10) if shapes > 1 else 0
        whole = range(shapes)
        self.shapes = list(whole[shapes - last :] if held_out and last else whole[: shapes - last])

    def cloud(self, shape: int, level: int) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3) float32 of a shape at a density, and their normals as stored integers."""
        first = shape * sum(self.counts) + sum(self.counts[:level])
        rows = slice(first, first + self.counts[level])
        points = self._points[rows] * np.float32(self._scales[shape])
        return points, self._normals[rows]

    def patch(self, size: int, noise: tuple[float, float], rng: np.random.Generator, level: int | None = None) -> Patch:
        """A patch around a random point of a random shape, in its principal frame.

        Parameters
        ----------
        size : int
            Points.
        noise : (float, float)
            The least and the largest deviation, in the unit of the clouds; log-uniform between them.
        rng : numpy Generator
        level : int, optional
            Of the density; otherwise all are equally likely.
        """
        level = int(rng.integers(len(self.counts))) if level is None else level
        shape = int(rng.choice(self.shapes))
        points, _ = self.cloud(shape, level)
        size = min(size, len(points))
        seed = points[rng.integers(len(points))]
        clean = points[_nearest(points, seed, min(int(WIDE * size), len(points)))] - seed
        reach = float(np.linalg.norm(clean[size - 1]))
        deviation = min(drawn(noise, rng), LARGEST * reach)
        moved = clean + deviation * rng.standard_normal(clean.shape, dtype=np.float32)
        place = moved[0]
        noisy = moved[_nearest(moved, place, size)] - place
        # The surface: from a denser cloud, if there is one.
        finer = min(level + 1, len(self.counts) - 1)
        dense, normals = self.cloud(shape, finer)
        ratio = self.counts[finer] / self.counts[level]
        near = _nearest(dense, seed, min(int(AROUND * size * ratio), len(dense)))
        turn = (random_turns(1, rng) @ principal_frames(noisy[None]))[0].astype(np.float32)
        surface = dense[near] - seed - place
        parts = (noisy, surface, normals[near] / np.float32(UNIT))
        disc = DISC * float(np.linalg.norm(dense[near[-1]] - seed)) / len(near) ** 0.5
        turned = [torch.from_numpy(x @ turn.T) for x in parts]
        return Patch(turned[0], turned[1], turned[2], disc)

    def region(self, share: float, noise: tuple[float, float], rng: np.random.Generator) -> tuple[Patch, float]:
        """A region around a random point of a random shape at a random density, wide enough for balls in its middle.

        Parameters
        ----------
        share : float
            The radius of the balls, relative to the diagonal of the shape's box.
        noise : (float, float)
            As of :meth:`patch`; at most a third of the radius.
        rng : numpy Generator

        Returns
        -------
        patch : Patch
            All noisy points within two and a half radii, and the surface there.
        radius : float
        """
        level, shape = int(rng.integers(len(self.counts))), int(rng.choice(self.shapes))
        points, _ = self.cloud(shape, level)
        radius = share * float(np.linalg.norm(np.ptp(points, axis=0)))
        seed = points[rng.integers(len(points))]
        clean = points[_within(points, seed, REGION * radius)] - seed
        deviation = min(drawn(noise, rng), radius / 3)
        moved = clean + deviation * rng.standard_normal(clean.shape, dtype=np.float32)
        dense, normals = self.cloud(shape, min(level + 1, len(self.counts) - 1))
        near = _within(dense, seed, REGION * radius)
        parts = (moved, dense[near] - seed, normals[near] / np.float32(UNIT))
        tensors = [torch.from_numpy(part) for part in parts]
        return Patch(tensors[0], tensors[1], tensors[2], DISC * REGION * radius / len(near) ** 0.5), radius


def drawn(noise: tuple[float, float], rng: np.random.Generator) -> float:
    """A deviation between two, log-uniform."""
    return float(np.exp(rng.uniform(*np.log(noise))))


def _within(points: np.ndarray, place: np.ndarray, radius: float) -> np.ndarray:
    """Indices of the points (n, 3) within a radius of a place, the nearest first; at least one."""
    squared = ((points - place) ** 2).sum(axis=1)
    some = np.flatnonzero(squared <= max(radius**2, squared.min()))
    return some[np.argsort(squared[some], kind="stable")]


def _nearest(points: np.ndarray, place: np.ndarray, count: int) -> np.ndarray:
    """Indices of the ``count`` points (n, 3) nearest a place, the nearest first."""
    squared = ((points - place) ** 2).sum(axis=1)
    some = np.argpartition(squared, count - 1)[:count] if count < len(points) else np.arange(len(points))
    return some[np.argsort(squared[some], kind="stable")]
