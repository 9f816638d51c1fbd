"""Iterative Poisson surface reconstruction, on Open3D's solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from bench import PointCloud, Run, register

from . import screened_poisson
from .poisson import weight_for
from .unoriented import outward_surface, points_for_poisson
from .visibility import facing

if TYPE_CHECKING:
    from scipy.spatial import cKDTree
    from trimesh import Trimesh

TOP = 0.001  # the share of the normals, those that changed most, by which convergence is tested
SEEKING = 4.0  # the point weight during the iteration: less fuses thin walls, more follows the noise
NEIGHBOURS = 16  # of the first normals: few, so that thin walls do not mix with their other side
SETTLED = 0.175  # the mean change of these, as a distance of unit vectors, below which the iteration ends: 10 degrees


@register("method", cite="Hou et al. 2022", requires=("open3d", "scipy", "trimesh"))
@dataclass(frozen=True)
class Ipsr:
    """Iterative Poisson surface reconstruction: normals are read off the surface that the last normals made.

    Needs no normals, and ignores those of the input. Each round solves screened Poisson once, and gives
    every point the area-weighted mean normal of the faces that have it among their nearest points. The common sign of
    all normals is fixed at the end: the surface encloses a positive volume. From random normals the paper takes
    up to 30 rounds; from normals by visibility a few suffice, and thin walls are oriented correctly from the start.
    """

    depth: int = 8  # octree depth, 5 to 12: 2^depth cells along the bounding cube
    rounds: int = 12  # Poisson solves at most; fewer if the normals settle
    # normals of the first round: outward where the space around is visible, along a tree of neighbours, or random.
    start: Literal["visible", "estimated", "random"] = "visible"
    k: int = 6  # points to which each face passes its normal; 10 in the paper
    # how strongly the surface is held to the points, in all rounds; None: 4, and in the last by their noise, 0.3 to 10
    point_weight: float | None = None
    scale: float = 1.1  # bounding cube of the reconstruction relative to that of the points
    samples_per_node: float = 1.0  # points per octree cell; more smooths noise away, and fuses thin sheets

    def __post_init__(self) -> None:
        screened_poisson.check_octree(self.depth, self.scale, self.point_weight or 0.0, self.samples_per_node)
        if self.rounds < 1:
            raise ValueError(f"rounds: expected at least 1, got {self.rounds}")
        if self.k < 1:
            raise ValueError(f"k: expected at least 1, got {self.k}")

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A closed surface, outward; the points with the normals found are stored as ``oriented``."""
        points = points_for_poisson(cloud, self.depth, self.scale, "ipsr", run)
        solution, normals = self._iterate(points, self._first(points, run), run)
        return outward_surface(solution, points, normals, "ipsr", run)

    def _first(self, points: np.ndarray, run: Run) -> np.ndarray:
        """Initial normals (n, 3); zeros where the start gives none."""
        from bench.geometry.normals import estimate_normals, oriented_normals

        if self.start == "random":
            normals = run.rng.standard_normal(points.shape)
            return normals / np.linalg.norm(normals, axis=1, keepdims=True)
        if self.start == "visible":
            normals = estimate_normals(points, NEIGHBOURS)[0]
            signs = facing(points, normals)
            if signs is not None:
                return signs[:, None] * normals
        # An open surface has no outside.
        return oriented_normals(points)

    def _iterate(
        self, points: np.ndarray, normals: np.ndarray, run: Run
    ) -> tuple[screened_poisson.Solution, np.ndarray]:
        """The last solution, and the normals (n, 3) derived from it."""
        from scipy.spatial import cKDTree

        tree = cKDTree(points)
        weight = SEEKING if self.point_weight is None else self.point_weight
        for done in range(1, self.rounds):
            before = run.elapsed()
            solution = self._solve(points, normals, weight)
            last, normals = normals, told_normals(solution.vertices, solution.faces, tree, self.k, normals)
            run.progress(done, self.rounds)
            if settled(last, normals):
                break
            if run.seconds_left() < 3 * (run.elapsed() - before):  # leaves time for the last round
                run.note(f"ipsr: stopped after {done} of {self.rounds} rounds, to stay within its time limit")
                break
        solution = self._solve(points, normals, weight_for(points, normals) if self.point_weight is None else weight)
        run.progress(self.rounds, self.rounds)
        return solution, told_normals(solution.vertices, solution.faces, tree, self.k, normals)

    def _solve(self, points: np.ndarray, normals: np.ndarray, weight: float) -> screened_poisson.Solution:
        known = normals.any(axis=1)
        return screened_poisson.solve(
            points[known],
            normals[known],
            depth=self.depth,
            scale=self.scale,
            samples_per_node=self.samples_per_node,
            point_weight=weight,
        )


def told_normals(vertices: np.ndarray, faces: np.ndarray, tree: cKDTree, k: int, fallback: np.ndarray) -> np.ndarray:
    """The area-weighted mean normal of the faces that have a point among the ``k`` nearest to their centre.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (f, 3) int array
    tree : cKDTree of the n points
    k : int
    fallback : (n, 3) array
        Normals of points without a near face.

    Returns
    -------
    (n, 3) float64 array of unit length
    """
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    nearest = tree.query((a + b + c) / 3, np.arange(1, min(k, tree.n) + 1))[1]
    weighted = np.repeat(np.cross(b - a, c - a), nearest.shape[1], axis=0)
    sums = np.stack([np.bincount(nearest.ravel(), weighted[:, axis], tree.n) for axis in range(3)], axis=1)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(lengths > 0, sums / np.where(lengths > 0, lengths, 1), fallback)


def settled(last: np.ndarray, normals: np.ndarray) -> bool:
    """Whether the unit normals (n, 3) have converged: the mean change of those that changed most is small."""
    changes = np.linalg.norm(normals - last, axis=1)
    count = max(1, round(TOP * len(changes)))
    return bool(np.partition(changes, -count)[-count:].mean() < SETTLED)
