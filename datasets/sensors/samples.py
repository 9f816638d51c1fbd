"""An idealised scanner: points spread over the whole surface, with noise and outliers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench import PointCloud, Shape, register
from bench.geometry.poisson_disk import sample_poisson_disk
from bench.geometry.used import used_vertices


@register("sensor", requires=("open3d",), cite="Poisson-disk elimination: Yuksel 2015")
@dataclass(frozen=True)
class Samples:
    """Points of the exact surface, uniform or Poisson-disk, with Gaussian noise, outliers and normals.

    Lengths are relative to the bounding-sphere radius, which is 1 in the frame of a case. The default noise of 0.5 %
    is that of a decent scan, and half of the lowest level at which denoisers are usually compared (1, 2, 3 %): without
    noise every interpolating method looks perfect, and with much noise no method recovers fine detail.

    Normals are the exact ones at the clean points, even after noise moves the points. An outlier replaces a point; its
    normal is a random direction.
    """

    count: int = 5000  # points, exactly
    sampling: Literal["poisson_disk", "uniform"] = "poisson_disk"  # evenly spread, or independent of each other
    noise: float = 0.005  # standard deviation of Gaussian noise in x, y and z, relative to the bounding-sphere radius
    outliers: float = 0.0  # fraction of the points that lie anywhere in the bounding box, inflated by 10 %; below 1
    normals: bool = True  # whether the cloud has normals

    def __post_init__(self) -> None:
        if self.count < 1:
            raise ValueError(f"count: expected at least 1, got {self.count}")
        if self.sampling not in ("poisson_disk", "uniform"):
            raise ValueError(f"sampling: expected poisson_disk or uniform, got {self.sampling!r}")
        if not 0 <= self.noise < np.inf:
            raise ValueError(f"noise: expected 0 or more, got {self.noise}")
        if not 0 <= self.outliers < 1:
            raise ValueError(f"outliers: expected 0 <= outliers < 1, got {self.outliers}")

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """A cloud of exactly ``count`` points of a shape in the frame of its case."""
        points, normals = self._clean(shape, rng)
        points = points + self.noise * rng.normal(size=points.shape)
        lost = rng.permutation(self.count)[: round(self.outliers * self.count)]
        vertices = used_vertices(shape.mesh)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        margin = 0.05 * (high - low)  # on either side: 10 % in total
        points[lost] = rng.uniform(low - margin, high + margin, size=(len(lost), 3))
        directions = rng.normal(size=(len(lost), 3))
        normals[lost] = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        return PointCloud(points, normals if self.normals else None)

    def _clean(self, shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        if self.sampling == "uniform":
            return shape.surface.sample(self.count, rng)
        return sample_poisson_disk(shape, self.count, rng)
