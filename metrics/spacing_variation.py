"""How much the spacing of a cloud varies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Case, PointCloud, register


@register("metric", version=1, better="lower", outputs=("cloud",), floor=True, requires=("scipy",))
@dataclass(frozen=True)
class SpacingVariation:
    """Coefficient of variation of the distance to the nearest neighbour, within the output.

    ``std(d) / mean(d)`` with d the distance of each output point to the nearest other one, a copy being at distance 0;
    dimensionless, and the same at any scale. Independent uniform points on a surface score ``sqrt(4 / pi - 1) = 0.523``
    (the floor), a lattice 0, Poisson-disk samples about 0.1 to 0.2. All points in one place score infinity.

    It needs no reference and says nothing about accuracy: noise across the surface spreads points evenly in space and
    can lower it, pairs of points at equal distances score 0, and a dense and a sparse half weigh by their counts. One
    far point among N adds its squared distance / N to the variance: a few such points decide it.
    """

    def score(self, output: PointCloud, case: Case) -> dict[str, float]:
        """``{"spacing_variation": dimensionless}``."""
        spacing = neighbour_distances(output.points) if len(output) > 1 else np.zeros(1)
        mean = spacing.mean()
        return {"spacing_variation": float(spacing.std() / mean) if mean > 0 else float("inf")}


def neighbour_distances(points: np.ndarray) -> np.ndarray:
    """The distance of each of (n, 3) points to the nearest other one, 0 where it has a copy: an (n,) array, n > 1."""
    from scipy.spatial import cKDTree

    distinct, at, counts = np.unique(points, axis=0, return_inverse=True, return_counts=True)
    if len(distinct) < 2:
        return np.zeros(len(points))
    nearest = cKDTree(distinct).query(distinct, 2)[0][:, 1]
    return np.where(counts > 1, 0.0, nearest)[at.ravel()]
