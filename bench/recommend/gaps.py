"""Gaps cut into a scan with holes of its own: the removed points judge how methods fill them.

Inside a hole there is no point to hold out. So the unsupported share of the surface is estimated from the meshes:
the part that is farther from every point than points there are from their neighbours. If that is not zero,
balls as wide as the holes are cut out of the scan, each method reconstructs the rest, and the points that were cut
out measure the distance to the surface known to be there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from ..geometry.cloud import PointCloud
from ..geometry.mesh_surface import MeshSurface
from ..seeds import generator
from .scan import Scan, reach_of, taken

if TYPE_CHECKING:
    from trimesh import Trimesh

SAMPLES = 3000  # of each mesh
LEAST = 0.01  # share of the surface below which a scan counts as complete
CUT = 0.15  # share of the points that are cut out
NARROWEST = 4.0  # radius of a gap, in spacings of the scan
WIDEST = 0.3  # in radii of the scan
MOST = 60  # gaps


@dataclass(frozen=True, eq=False)
class Gaps:
    """The points cut out of a scan.

    Attributes
    ----------
    hidden : float
        Estimated share of the surface that no point of the scan supports.
    radius : float
        Of the balls, in radii of the scan.
    removed : (n,) bool array
        Which points of the subsample lie in one of them.
    """

    hidden: float
    radius: float
    removed: np.ndarray

    def rest(self, scan: Scan) -> PointCloud:
        """The scan without them."""
        return taken(scan.cloud, ~self.removed)


def gaps_of(scan: Scan, meshes: Sequence[Trimesh], families: Sequence[str], seed: int) -> Gaps | None:
    """The gaps to cut into a scan; None if its points leave no hole.

    Parameters
    ----------
    scan : Scan
    meshes : the mesh of each of k methods
    families : k names
        The share that no point supports is a mean in which methods of one family count once.
    seed : int
        Of the samples and of the places.
    """
    tree = cKDTree(scan.cloud.points[~scan.outlier])
    reach = reach_of(tree)
    shares, depths = [], []
    for mesh in meshes:
        samples, _ = MeshSurface(mesh).sample(SAMPLES, generator(seed, "hidden"))
        distance, at = tree.query(samples)
        alone = distance > reach[at]
        shares.append(alone.mean())
        depths.append(distance[alone])
    names = np.asarray(families)
    hidden = float(np.average(shares, weights=1 / (names[:, None] == names).sum(axis=0)))
    if hidden < LEAST:
        return None
    deepest = np.quantile(np.concatenate(depths), 0.9)
    radius = float(max(min(deepest, WIDEST), NARROWEST * scan.spacing))
    return Gaps(hidden, radius, _cut(scan, radius, generator(seed, "gaps")))


def _cut(scan: Scan, radius: float, rng: np.random.Generator) -> np.ndarray:
    """The points in balls around points drawn at random, until enough of them are cut; at least half are left."""
    tree, good = cKDTree(scan.cloud.points), np.flatnonzero(~scan.outlier)
    removed = np.zeros(len(scan.cloud), bool)
    for centre in rng.choice(good, min(MOST, len(good)), replace=False):
        ball = tree.query_ball_point(scan.cloud.points[centre], radius)
        with_it = removed.copy()
        with_it[ball] = True
        if with_it.mean() <= 0.5:
            removed = with_it
        if removed[good].mean() >= CUT:
            break
    return removed
