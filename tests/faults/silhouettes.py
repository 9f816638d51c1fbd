"""A task over images that the bench does not have, with a rig that logs its work, an effect on images, and methods."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from bench import Case, Effect, Run, Shape, Task, Views, register, validate_mesh
from bench.authoring.conformance import toy_views


@register("task")
@dataclass(frozen=True)
class Silhouettes(Task):
    """Images of a shape -> its mesh."""

    takes: ClassVar[str] = "views"
    output: ClassVar[str] = "mesh"
    promise: ClassVar[str] = "a mesh"

    def describe(self, case: Case) -> dict[str, float]:
        return {"covered": float(case.input["views"].masks.mean())}

    def describe_words(self, medians: Mapping[str, float]) -> str:
        return f"the shape covers {medians['covered']:.0%} of its images."

    def validate(self, output: Any, input: dict[str, Any]) -> None:
        validate_mesh(output, self.promise)


@register("sensor", gives="views")
@dataclass(frozen=True)
class LoggedRig:
    """Small images of a ball, whatever the shape; each call is logged. Casting rays takes a library that takes long."""

    def sense(self, shape: Shape, rng: np.random.Generator) -> Views:
        if log := os.environ.get("TOY_LOG"):
            with open(log, "a") as file:
                file.write(f"\nrig 0 {shape.id} {time.time():.3f}\n")
        return toy_views()


@register("sensor", gives="views")
@dataclass(frozen=True)
class Liar:
    """Promises views and gives a number."""

    def sense(self, shape: Shape, rng: np.random.Generator) -> float:
        return 1.0


@register("sensor", gives="views")
@dataclass(frozen=True)
class Night(Effect):
    """Darker images."""

    brightness: float = 0.5

    def spoil(self, views: Views, shape: Shape, rng: np.random.Generator) -> Views:
        return Views.of(views.arrays() | {"images": (self.brightness * views.images).astype(np.uint8)})


@register("method", requires=("skimage", "trimesh"))
@dataclass(frozen=True)
class CubesInMasks:
    """What lies inside every silhouette."""

    grid: int = 20

    def silhouettes(self, views: Views, run: Run):
        from skimage.measure import marching_cubes
        from trimesh import Trimesh

        line = np.linspace(-1.1, 1.1, self.grid)
        points = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
        pixels, depth = views.project(points)
        columns, rows = np.moveaxis(np.floor(pixels).astype(int), -1, 0)
        seen = (depth > 0) & (columns >= 0) & (columns < views.width) & (rows >= 0) & (rows < views.height)
        inside = np.ones(len(points), dtype=bool)
        for mask, column, row, there in zip(views.masks, columns, rows, seen, strict=True):
            inside[there] &= mask[row[there], column[there]]
            inside[~there] = False
        inside[np.abs(points).max(axis=1) > 1.09] = False
        run.keep("first_image", views.images[0])
        run.keep("inside", lambda: {"inside": inside.reshape(3 * [self.grid])})
        vertices, faces, _, _ = marching_cubes(inside.reshape(3 * [self.grid]).astype(float), 0.5)
        hull = Trimesh(line[0] + vertices * (line[1] - line[0]), faces[:, ::-1], process=False)
        run.trace(hull, keep=True)
        return hull


@register("method")
@dataclass(frozen=True)
class KeepsAll:
    """A cloud, with one of each kind of artefact beside it."""

    name: str = "cage"
    odd: bool = False  # keep something that cannot be stored

    def denoise(self, cloud, run: Run):
        from trimesh.creation import box

        run.keep(self.name, box())
        run.keep("cloud", cloud)
        run.keep("gray", np.arange(12, dtype=np.uint8).reshape(3, 4))
        run.keep("field", lambda: {"values": np.arange(3.0), "file": np.array(["a"])})
        run.trace(cloud)
        run.trace(lambda: cloud, keep=True)
        if self.odd:
            run.keep("number", 7)
        return cloud
