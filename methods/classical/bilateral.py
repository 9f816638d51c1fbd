"""Bilateral smoothing of points and normals, by CGAL."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Run, register

from .inputs import distinct_oriented
from .isolated import put_back, without_isolated
from .noise import noise_to_spacing


@register("method", cite="Huang et al. 2013, section 4", requires=("CGAL", "scipy"))
@dataclass(frozen=True)
class Bilateral:
    """Bilateral smoothing: points move along normals that count less the more they differ, which keeps edges."""

    k: int | None = None  # neighbours; more smooth more; None: by the noise, 12 to 64
    iterations: int = 1  # passes; three or more flatten fine detail
    angle: float = 20.0  # degrees by which normals may differ before their weight falls; 90 ignores edges

    def __post_init__(self) -> None:
        if self.k is not None and self.k < 3:
            raise ValueError(f"k: expected at least 3, got {self.k}")
        if self.iterations < 1:
            raise ValueError(f"iterations: expected at least 1, got {self.iterations}")
        check_angle("angle", self.angle)

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the input has, in its order, with the smoothed normals."""
        rest, kept = without_isolated(cloud, "bilateral", run)
        points, normals, inverse = distinct_oriented(rest, "bilateral", at_least=10)
        k = neighbours_for(points, normals) if self.k is None else self.k
        points, normals = smooth(points, normals, k, self.iterations, self.angle, run)
        return put_back(cloud, kept, points[inverse], normals[inverse])


def neighbours_for(points: np.ndarray, normals: np.ndarray) -> int:
    """The number of neighbours that was best on the train shapes at the noise of these points, see docs/tuning.md."""
    return int(np.clip(12 * np.exp(5 * noise_to_spacing(points, normals)), 12, 64))


def check_angle(name: str, angle: float) -> None:
    """Raise ValueError for an angle that CGAL does not support."""
    if not 0 < angle <= 90:
        raise ValueError(f"{name}: expected degrees above 0 and up to 90, got {angle}")


def smooth(
    points: np.ndarray, normals: np.ndarray, k: int, passes: int, angle: float, run: Run
) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals after some passes of bilateral smoothing: two arrays of the shape of the input's.

    Parameters
    ----------
    points, normals : (n, 3) arrays, the points all different, the normals of unit length
    k : int
        Neighbours.
    passes : int
    angle : float
        In degrees.
    run : Run
        Receives the progress.
    """
    from CGAL.CGAL_Point_set_processing_3 import bilateral_smooth_point_set

    from .point_sets import to_array, to_normals, to_point_set

    point_set = to_point_set(points, normals)
    for done in range(passes):
        # The third argument is a radius, 0 for none: an angle there makes all points NaN.
        bilateral_smooth_point_set(point_set, min(k, len(points) - 1), 0.0, angle)
        run.progress(done + 1, passes)
    moved, turned = to_array(point_set), to_normals(point_set)
    lengths = np.linalg.norm(turned, axis=1)
    # Opposite normals, as on both sides of a thin sheet, can cancel.
    good = (np.isfinite(moved).all(axis=1) & np.isfinite(lengths) & (lengths > 0))[:, None]
    turned = turned / np.where(good, lengths[:, None], 1.0)
    return np.where(good, moved, points), np.where(good, turned, normals)
