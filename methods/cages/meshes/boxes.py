"""The unit of the shapes for a network: the target's box, its longest edge from -1 to 1."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bench import PointCloud

if TYPE_CHECKING:
    from trimesh import Trimesh


class Boxed(NamedTuple):
    """A source and a target in that unit, each around its own box centre."""

    vertices: np.ndarray
    """(v, 3) array: the source's"""
    source: np.ndarray
    """(n, 3) array: points of its surface"""
    target: np.ndarray
    """(m, 3) array: points of the target"""
    scale: float
    """half the longest edge of the target's box"""
    centre: np.ndarray
    """(3,) array: of the target's box"""

    def restored(self, source: Trimesh, vertices: np.ndarray) -> Trimesh:
        """The source mesh with deformed vertices (v, 3) of that unit, at the place of the target."""
        output = source.copy()
        output.vertices = np.asarray(vertices, dtype=np.float64) * self.scale + self.centre
        return output


def boxed(source: Trimesh, target: Trimesh | PointCloud, points: int, rng: np.random.Generator) -> Boxed:
    """Vertices, and ``points`` random points of each surface, in the unit of the target's box.

    The source is scaled by the target's box too: the task determines their relative size.
    """
    from bench.geometry.sampling import sample_uniform
    from bench.geometry.used import used_vertices

    used = used_vertices(source)
    if isinstance(target, PointCloud):
        theirs = target.points
        given = theirs if len(theirs) <= points else theirs[rng.choice(len(theirs), points, replace=False)]
    else:
        theirs = used_vertices(target)
        given = sample_uniform(target, points, rng)[0]
    low, extent = theirs.min(axis=0), np.ptp(theirs, axis=0)
    centre, scale = low + extent / 2, float(extent.max() / 2) or 1.0
    own = used.min(axis=0) + np.ptp(used, axis=0) / 2
    sampled = sample_uniform(source, points, rng)[0]
    return Boxed((source.vertices - own) / scale, (sampled - own) / scale, (given - centre) / scale, scale, centre)
