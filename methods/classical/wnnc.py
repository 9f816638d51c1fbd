"""Winding number normal consistency, then screened Poisson on Open3D's solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import PointCloud, Run, register

from . import screened_poisson
from .poisson import weight_for
from .unoriented import outward_surface, points_for_poisson

if TYPE_CHECKING:
    from trimesh import Trimesh

SHARE = 0.5  # of the time that may go into the normals; the rest is for the surface


@register("method", cite="Lin et al. 2024", requires=("numba", "open3d", "scipy", "trimesh"))
@dataclass(frozen=True)
class Wnnc:
    """Winding number normal consistency: normals that agree with the gradient of the winding number field they make.

    Needs no normals, and ignores those of the input. The target value of the field is one half at the points; each
    round takes a step of steepest descent towards that, and turns the normals against the field's gradient. Pairs of
    points nearer to each other than a width are ignored, and the width shrinks from round to round. The surface through
    the oriented points is that of screened Poisson, and encloses a positive volume.

    The paper's: the iteration, from zero, its 40 rounds, and a linear schedule of the width. Ours: widths from
    the spacing and the noise of the points (theirs: a pair of numbers that the user picks by the noise), and a sum that
    traverses its tree once.
    """

    rounds: int = 40  # of descent and turning
    # of the last round and of the first, in mean spacings; wider tolerates noise, but mixes the sides of thin walls
    widths: tuple[float, float] = (1.0, 4.0)
    noise: float = 1.0  # deviations of the noise, added to the spacing in squares; 0 for none
    opening: float = 0.4  # radius over distance of clusters that count as one point; 0: exact sums, in n^2
    depth: int = 8  # octree depth of the surface, 5 to 12: 2^depth cells along the bounding cube
    point_weight: float | None = None  # how strongly points hold the surface; 0: not; None: by their noise, 0.3 to 10
    scale: float = 1.1  # bounding cube of the reconstruction relative to that of the points
    samples_per_node: float = 1.5  # points per octree cell; 5 to 20 smooths noise away

    def __post_init__(self) -> None:
        screened_poisson.check_octree(self.depth, self.scale, self.point_weight or 0.0, self.samples_per_node)
        if self.rounds < 1:
            raise ValueError(f"rounds: expected at least 1, got {self.rounds}")
        if not 0 < self.widths[0] <= self.widths[1] < np.inf:
            raise ValueError(f"widths: expected two numbers above 0, the smaller first, got {self.widths}")
        if not 0 <= self.noise < np.inf:
            raise ValueError(f"noise: expected at least 0, got {self.noise}")
        if not 0 <= self.opening < 1:
            raise ValueError(f"opening: expected a number from 0 to below 1, got {self.opening}")

    def prepare(self) -> None:
        """Compile the sums."""
        from .winding.field import load_compiled

        load_compiled()

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A closed surface, outward; the points with the normals found are stored as ``oriented``."""
        points = points_for_poisson(cloud, self.depth, self.scale, "wnnc", run)
        normals = self._normals(points, run)
        solution = screened_poisson.solve(
            points,
            normals,
            depth=self.depth,
            scale=self.scale,
            samples_per_node=self.samples_per_node,
            point_weight=weight_for(points, normals) if self.point_weight is None else self.point_weight,
        )
        return outward_surface(solution, points, normals, "wnnc", run)

    def _normals(self, points: np.ndarray, run: Run) -> np.ndarray:
        """Normals (n, 3) of unit length, all outward or all inward."""
        from bench.geometry.spacing import mean_spacing

        from .noise import noise_without_normals
        from .winding.consistency import consistent_normals
        from .winding.field import WindingField

        last, first = np.array(self.widths) * np.hypot(mean_spacing(points), self.noise * noise_without_normals(points))
        field = WindingField(points, self.opening, run.threads)
        normals, done = consistent_normals(field, np.linspace(first, last, self.rounds), run, SHARE)
        if done < self.rounds:
            run.note(f"wnnc: stopped after {done} of {self.rounds} rounds, to stay within its time limit")
        return normals
