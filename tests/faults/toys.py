"""Plugins for tests: a tiny world (dataset, sensor, metric), good methods, and methods that do every bad thing once.

Each bad method misbehaves at the case of index 1 alone; at the others it returns the cloud. Each call is logged.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Run, Shape, register

POINTS, PER_INDEX = 100, 10  # the count of points tells a method which case it is given


@register("dataset", requires=("trimesh",))
@dataclass(frozen=True)
class Ball:
    """Spheres of 162 vertices."""

    stretch: float = 1.0  # along z

    def shapes(self, split: str):
        for index in range(50):
            yield Shape(f"ball-{split}-{index:03d}", self._mesh)

    def _mesh(self):
        from trimesh.creation import icosphere

        mesh = icosphere(subdivisions=2)
        mesh.vertices *= (1.0, 1.0, self.stretch)
        return mesh


@register("sensor")
@dataclass(frozen=True)
class Dots:
    """Vertices, drawn at random."""

    jitter: float = 0.01  # standard deviation

    def __post_init__(self) -> None:
        if self.jitter < 0:
            raise ValueError(f"jitter: expected 0 or more, got {self.jitter}")

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud:
        count = POINTS + PER_INDEX * int(shape.id[-3:])
        points = shape.mesh.vertices[rng.integers(len(shape.mesh.vertices), size=count)]
        return PointCloud(points + rng.normal(scale=self.jitter, size=(count, 3)))


@register("metric", version=1, better="lower")
@dataclass(frozen=True)
class Spread:
    """Mean distance to the origin."""

    def score(self, output, case) -> dict[str, float]:
        points = output.points if isinstance(output, PointCloud) else output.vertices
        return {"spread": float(np.linalg.norm(points, axis=1).mean())}


def called(name: str, cloud: PointCloud, run: Run, seed: int = 0) -> int:
    """Log one call; the case's index."""
    index = (len(cloud) - POINTS) // PER_INDEX
    if log := os.environ.get("TOY_LOG"):
        with open(log, "a") as file:
            processors = ",".join(map(str, sorted(os.sched_getaffinity(0))))
            file.write(f"\n{name} {seed} {index} {time.time():.3f} {os.getpid()} {processors}\n")
    return index


@register("method")
@dataclass(frozen=True)
class Prepared:
    """Takes its time, or fails, before it is called."""

    take: float = 0.0  # seconds
    fail: bool = False

    def prepare(self) -> None:
        time.sleep(self.take)
        if self.fail:
            raise OSError("no weights can be had")

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        called("prepared", cloud, run)
        return cloud


@register("method")
@dataclass(frozen=True)
class Fine:
    """Does nothing, well."""

    take: float = 0.0  # seconds
    at: int = -1  # at which case alone it takes them; -1: at all
    salt: int = 0  # makes another cell

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        index = called("fine", cloud, run, self.salt)
        if self.at in (-1, index):
            time.sleep(self.take)
        return cloud


def bad(
    function: Callable[[PointCloud, Run], object] | None = None,
    *,
    task: str = "denoise",
    requires: tuple[str, ...] = (),
):
    """Register a method whose call at the case of index 1 is ``function``."""
    if function is None:
        return lambda function: bad(function, task=task, requires=requires)
    name = function.__name__

    def usual(cloud: PointCloud, ratio: int) -> object:
        if task == "upsample":
            return PointCloud(np.repeat(cloud.points, ratio, axis=0))
        if task == "reconstruct":
            from trimesh.creation import icosphere

            return icosphere(subdivisions=1)
        return cloud

    def solve(self, cloud: PointCloud, run: Run, ratio: int = 1) -> object:
        if called(name, cloud, run) == 1:
            result = function(cloud, run)
            return usual(cloud, ratio) if result is BEHAVED else result
        return usual(cloud, ratio)

    cls = type(name, (), {"__doc__": f"Misbehaves: {name}.", "__module__": __name__, "__qualname__": name, task: solve})
    register("method", name, requires=requires)(dataclass(frozen=True)(cls))
    return function


BEHAVED = object()  # the function did its mischief and the method returns what it should
