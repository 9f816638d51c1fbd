"""Points and frames: :class:`PointCloud` and :class:`Frame`.

A mesh is a ``trimesh.Trimesh`` made with ``process=False``; there is no mesh class of our own. This module imports
numpy and nothing else, so that plugins, and the commands that only list them, start fast.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from ..errors import BadInput

SCALAR = "scalar_"  # before the names of scalars among the arrays of a cloud


def _own(values: Any) -> np.ndarray:
    """The values as an immutable array: a copy, unless they are frozen already."""
    is_frozen = isinstance(values, np.ndarray) and values.flags.owndata and not values.flags.writeable
    return values if is_frozen and values.dtype == np.float64 else np.array(values, dtype=np.float64)


def _rows_of_three(name: str, values: Any) -> np.ndarray:
    array = _own(values)
    if array.ndim != 2 or array.shape[1] != 3:
        raise BadInput(f"PointCloud.{name}: expected an array of shape (N, 3), got {array.shape}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points of a surface, immutable.

    Parameters
    ----------
    points : (N, 3) float64 array
    normals : (N, 3) float64 array of unit length, or None
    colors : (N, 3) float64 array in 0..1, or None
    scalars : mapping of names to (N,) float64 arrays, or None for an empty one
        Further numbers of each point: intensity, time, class, ... NaN for points without a value.

    Raises
    ------
    BadInput
        If an array has another shape, or other than N rows. Values are not checked here: the output of a *method* is
        checked by its task, so that a NaN is recorded as an invalid output.

    Example
    -------
    >>> cloud = PointCloud(np.eye(3), normals=np.eye(3), scalars={"intensity": [0.5, 0.1, 0.9]})
    >>> cloud
    PointCloud(3 points, normals, intensity)
    >>> len(cloud.subset(cloud.scalars["intensity"] > 0.3))
    2
    """

    points: np.ndarray
    normals: np.ndarray | None = None
    colors: np.ndarray | None = None
    scalars: Mapping[str, np.ndarray] = None  # type: ignore[assignment]  # it becomes an empty one, see below

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _rows_of_three("points", self.points))
        for name in ("normals", "colors"):
            values = getattr(self, name)
            if values is None:
                continue
            values = _rows_of_three(name, values)
            if len(values) != len(self.points):
                raise BadInput(f"PointCloud.{name}: {len(values)} rows for {len(self.points)} points")
            object.__setattr__(self, name, values)
        scalars = {str(name): self._scalar(name, values) for name, values in (self.scalars or {}).items()}
        object.__setattr__(self, "scalars", MappingProxyType(scalars))

    def _scalar(self, name: str, values: Any) -> np.ndarray:
        array = _own(values)
        if array.shape != (len(self.points),):
            raise BadInput(f"PointCloud.scalars[{name!r}]: expected shape ({len(self.points)},), got {array.shape}")
        array.setflags(write=False)
        return array

    def __reduce__(self) -> tuple[Any, ...]:  # the read-only view of the scalars cannot be pickled
        return PointCloud.of, (self.arrays(),)

    def __len__(self) -> int:
        return len(self.points)

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays by name, without those that are None; :meth:`of` makes the same cloud of them."""
        given = {"points": self.points, "normals": self.normals, "colors": self.colors}
        given |= {SCALAR + name: values for name, values in self.scalars.items()}
        return {name: array for name, array in given.items() if array is not None}

    @classmethod
    def of(cls, arrays: Mapping[str, np.ndarray]) -> PointCloud:
        """The inverse of :meth:`arrays`."""
        scalars = {name.removeprefix(SCALAR): array for name, array in arrays.items() if name.startswith(SCALAR)}
        return cls(arrays["points"], arrays.get("normals"), arrays.get("colors"), scalars)

    def subset(self, rows: np.ndarray) -> PointCloud:
        """The points at ``rows``, an (N,) bool array or an array of indices, with all their attributes."""
        return PointCloud.of({name: array[rows] for name, array in self.arrays().items()})

    def moved(self, points: np.ndarray) -> PointCloud:
        """The cloud with its points at other places, (N, 3); their attributes stay."""
        return PointCloud.of(self.arrays() | {"points": points})

    def __repr__(self) -> str:
        extras = [name for name in ("normals", "colors") if getattr(self, name) is not None]
        extras += self.scalars
        return f"PointCloud({len(self)} points{''.join(', ' + e for e in extras)})"


@dataclass(frozen=True)
class Frame:
    """The similarity that takes original coordinates to the frame of a case: ``(x - center) / radius``."""

    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float = 1.0

    @classmethod
    def of(cls, points: np.ndarray) -> Frame:
        """The frame in which ``points`` (n, 3) have their box centre at the origin and the farthest at radius 1."""
        points = np.asarray(points, dtype=np.float64)
        center = (points.min(axis=0) + points.max(axis=0)) / 2
        radius = float(np.sqrt(((points - center) ** 2).sum(axis=1).max()))
        if not radius > 0 or not np.isfinite(radius):
            raise BadInput(f"all {len(points)} points coincide or are not finite: there is no extent to scale to 1")
        x, y, z = (float(c) for c in center)
        return cls((x, y, z), radius)

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Original coordinates -> the case's frame."""
        return (np.asarray(points, dtype=np.float64) - self.center) / self.radius

    def invert(self, points: np.ndarray) -> np.ndarray:
        """The case's frame -> original coordinates."""
        return np.asarray(points, dtype=np.float64) * self.radius + self.center
