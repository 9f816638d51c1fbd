"""Correspondences by nearest points, in both directions, as one goal for each sample of a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from bench import PointCloud

CLEARLY = 0.9  # times as far


@dataclass(frozen=True)
class Matching:
    """The rule for matching points.

    Parameters
    ----------
    normal_scale : float
        Two opposite normals are as far apart as points at twice this distance: nearest points are those of least
        ``|p - q|^2 + normal_scale^2 |n - m|^2``. 0 to ignore normals.
    trim : float
        Pairs farther apart than this many times the median of their direction are left out.
    sliding : float
        From 0 to 1, the share of the tangential displacement that is left out of a goal: with 1 only the distance to
        the target's tangent plane counts, if there are normals.
    """

    normal_scale: float
    trim: float
    sliding: float

    def goals(self, points: np.ndarray, normals: np.ndarray, target: PointCloud) -> tuple[np.ndarray, np.ndarray]:
        """The goal of each sample of a mesh, and its weight.

        Parameters
        ----------
        points, normals : (s, 3) arrays
        target : PointCloud

        Returns
        -------
        goals : (s, 3) array
            The weighted mean of the partners: the nearest point of the target, and those points of the target whose
            nearest sample this is.
        weights : (s,) array
            1 / s for the first and 1 / len(target) for each of the second; 0 without partner.
        """
        ours, theirs = self._place(points, normals, target), self._place(target.points, target.normals, target)
        every, all = np.arange(len(points)), np.arange(len(target))
        pairs = [(every, cKDTree(theirs).query(ours)[1]), (cKDTree(ours).query(theirs)[1], all)]
        total, weights = np.zeros(points.shape), np.zeros(len(points))
        for (mine, other), weight in zip(pairs, (1 / len(points), 1 / len(target)), strict=True):
            way = target.points[other] - points[mine]
            distance = np.linalg.norm(way, axis=1)
            kept = distance <= self.trim * np.median(distance)
            if target.normals is not None:
                if self.normal_scale:
                    kept &= np.einsum("ni,ni->n", normals[mine], target.normals[other]) > 0
                across = np.einsum("ni,ni->n", way, target.normals[other])[:, None] * target.normals[other]
                way = across + (1 - self.sliding) * (way - across)
            mine, way = mine[kept], way[kept]
            for axis in range(3):
                total[:, axis] += weight * np.bincount(mine, way[:, axis], len(points))
            weights += weight * np.bincount(mine, minlength=len(points))
        return points + np.divide(total, weights[:, None], out=total, where=weights[:, None] > 0), weights

    def sign(self, points: np.ndarray, normals: np.ndarray, target: PointCloud) -> int:
        """-1 for a mesh that is clearly inside out: with flipped normals it is nearer to the target. Otherwise 1."""
        if target.normals is None or not self.normal_scale:
            return 1
        tree = cKDTree(self._place(target.points, target.normals, target))
        along, against = (tree.query(self._place(points, s * normals, target))[0].mean() for s in (1, -1))
        return -1 if against < CLEARLY * along else 1

    def _place(self, points: np.ndarray, normals: np.ndarray | None, target: PointCloud) -> np.ndarray:
        """Points (n, 3), or (n, 6) with their normals if the target has normals and they count."""
        if target.normals is None or not self.normal_scale:
            return points
        assert normals is not None  # normals count only if both shapes have them
        return np.hstack([points, self.normal_scale * normals])
