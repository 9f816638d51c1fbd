"""Common functions of the effects: move, replace or remove points, and the units of their lengths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from bench import BadInput, PointCloud, Shape, Views
from bench.geometry.used import used_vertices

Unit = Literal["radius", "diagonal"]
UNITS = ("radius", "diagonal")


def in_units(length: float, unit: Unit, shape: Shape) -> float:
    """A length that is relative to the bounding-sphere radius or the box diagonal, in the coordinates of the case.

    The radius is 1 in the frame of a case; the diagonal is between 2 and 3.46, by the shape.
    """
    return length if unit == "radius" else length * float(np.linalg.norm(np.ptp(used_vertices(shape.mesh), axis=0)))


def moved(cloud: PointCloud, points: np.ndarray) -> PointCloud:
    """The cloud at other points, with its normals and colours."""
    return PointCloud(points, cloud.normals, cloud.colors)


def with_normals(cloud: PointCloud, normals: np.ndarray | None) -> PointCloud:
    """The cloud with other normals."""
    return PointCloud(cloud.points, normals, cloud.colors)


def kept(cloud: PointCloud, chosen: np.ndarray, shape: Shape, effect: str) -> PointCloud:
    """The points that ``chosen``, a mask or indices, selects.

    Raises
    ------
    BadInput
        If it selects none.
    """
    points = cloud.points[chosen]
    if not len(points):
        raise BadInput(f"sensor {effect}: removes all {len(cloud)} points of {shape.id}; choose weaker parameters")
    normals, colors = (None if values is None else values[chosen] for values in (cloud.normals, cloud.colors))
    return PointCloud(points, normals, colors)


def seen_as(views: Views, **changes: np.ndarray) -> Views:
    """The views with other arrays in place of some.

    Raises
    ------
    BadInput
        If no mask shows the shape.
    """
    if "masks" in changes and not changes["masks"].any():
        raise BadInput(f"none of the {len(changes['masks'])} remaining views shows the shape; degrade them less")
    return Views.of(views.arrays() | changes)


def replaced(
    cloud: PointCloud, which: np.ndarray, points: np.ndarray, rng: np.random.Generator, *, turn: bool = True
) -> PointCloud:
    """The cloud with its points ``which`` (indices) replaced; with ``turn``, their normals in random directions."""
    everywhere = cloud.points.copy()
    everywhere[which] = points
    if cloud.normals is None or not turn:
        return moved(cloud, everywhere)
    normals = cloud.normals.copy()
    normals[which] = random_directions(len(which), rng)
    return PointCloud(everywhere, normals, cloud.colors)


def some_of(cloud: PointCloud, fraction: float, rng: np.random.Generator) -> np.ndarray:
    """The indices of ``round(fraction * n)`` points, in random order."""
    return rng.permutation(len(cloud))[: round(fraction * len(cloud))]


def random_directions(count: int, rng: np.random.Generator) -> np.ndarray:
    """Unit vectors, uniform on the sphere: a (count, 3) array."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def unit(direction: Sequence[float] | None, rng: np.random.Generator) -> np.ndarray:
    """A direction scaled to length 1, or a random one for None: a (3,) array."""
    if direction is None:
        return random_directions(1, rng)[0]
    return np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)


def inflated_box(shape: Shape, inflation: float) -> tuple[np.ndarray, np.ndarray]:
    """The corners of the bounding box of a shape, its sides longer by a fraction: two (3,) arrays."""
    vertices = used_vertices(shape.mesh)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    margin = inflation / 2 * (high - low)
    return np.asarray(low - margin), np.asarray(high + margin)
