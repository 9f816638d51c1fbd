"""Evidence from a scan about the meshes reconstructed from it, and from its halves.

A method reconstructs the scan and, separately, two random halves of it. The mesh of one half does not depend on
the points of the other, so these judge it; and methods that err in different ways judge each other::

    held-out point      -> closest point of the mesh        a surface that is missing, or that follows the noise
    sample of the mesh  -> nearest held-out point           a sheet beside the points, a bag around them
    sample of the mesh  -> the mesh of the other half       what depends on the accident of sampling
    sample of the whole -> the other methods' wholes        a surface that no other method finds
    point of a gap      <-> the mesh of the scan with gaps  how holes are filled, where the scan has any

One direction alone favours wrong meshes: one that fills the space near the points, or one that is
missing where points are few. The scan is cut into patches with separate means: they show how certain a
difference is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from ..geometry.mesh_surface import MeshSurface
from ..geometry.topology import count_topology
from ..seeds import generator

if TYPE_CHECKING:
    from trimesh import Trimesh

    from .gaps import Gaps
    from .scan import Scan


SAMPLES = 2000  # of each mesh
PATCHES = 24  # of a scan


@dataclass(frozen=True, eq=False)
class Evidence:
    """Distances in radii of the scan: for each patch their sum and their number.

    Attributes
    ----------
    to_mesh, to_points : (k, 2, patches) arrays
        Held-out points to the mesh of the other half, and samples of that mesh to the held-out points.
    halves : (k, 2, patches) array
        Samples of the mesh of each half to the mesh of the other.
    apart : (k, k, 2, patches) array
        ``apart[i, j]``: samples of method i's mesh of the scan to that of method j.
    median_held : (k,) array
        Median distance of the held-out points to the mesh.
    gap_to_mesh, gap_to_points : (k, 2, patches) arrays
        Points of gaps to the mesh made without them, and samples of that mesh nearest to them; zero without gaps.
    hidden : float
        Estimated share of the surface that no point supports; 0 without gaps.
    pieces, open_edges : (k,) int arrays
        Of the mesh of the scan: components, and edges of exactly one face.
    """

    to_mesh: np.ndarray
    to_points: np.ndarray
    halves: np.ndarray
    apart: np.ndarray
    median_held: np.ndarray
    gap_to_mesh: np.ndarray
    gap_to_points: np.ndarray
    hidden: float
    pieces: np.ndarray
    open_edges: np.ndarray


def evidence(
    scan: Scan,
    meshes: Sequence[Sequence[Trimesh]],
    seed: int,
    gaps: Gaps | None = None,
    filled: Sequence[Trimesh] = (),
) -> Evidence:
    """Compare the meshes of k methods with the points of a scan and with each other.

    Parameters
    ----------
    scan : Scan
    meshes : for each of k methods its meshes of the scan, of the first half and of the second
        In the frame of the scan.
    seed : int
        Of the samples.
    gaps : the cut-out points, if the scan has holes
    filled : with ``gaps``, the mesh of each method from the remaining points
    """
    k = len(meshes)
    surfaces = [[MeshSurface(mesh) for mesh in three] for three in meshes]
    # Each part of each method has the same random numbers: equal meshes get equal figures.
    samples = [
        [surface.sample(SAMPLES, generator(seed, "samples", part))[0] for part, surface in enumerate(three)]
        for three in surfaces
    ]
    points = _Points(scan)
    to_mesh, to_points, halves = np.zeros((3, k, 2, PATCHES))
    apart, median_held = np.zeros((k, k, 2, PATCHES)), np.zeros(k)
    for i in range(k):
        held = []
        for half in (0, 1):
            mesh, other = surfaces[i][1 + half], surfaces[i][2 - half]
            out, patch = points.held[1 - half]
            held.append(mesh.project(out).distance)
            to_mesh[i] += _sums(held[-1], patch)
            distance, at = points.nearest(samples[i][1 + half], 1 - half)
            to_points[i] += _sums(distance, at)
            halves[i] += _sums(other.project(samples[i][1 + half]).distance, at)
        median_held[i] = np.median(np.concatenate(held))
        at = points.nearest(samples[i][0], 0)[1]
        for j in range(k):
            if i != j:
                apart[i, j] = _sums(surfaces[j][0].project(samples[i][0]).distance, at)
    gap_to_mesh, gap_to_points = np.zeros((2, k, 2, PATCHES))
    if gaps is not None:
        for i, mesh in enumerate(filled):
            gap_to_mesh[i], gap_to_points[i] = points.across(gaps.removed, MeshSurface(mesh), seed)
    counts = [count_topology(three[0].vertices, three[0].faces) for three in meshes]
    pieces, open_edges = np.array([(c.components, c.boundary_edges) for c in counts]).T
    return Evidence(
        to_mesh,
        to_points,
        halves,
        apart,
        median_held,
        gap_to_mesh,
        gap_to_points,
        gaps.hidden if gaps else 0.0,
        pieces,
        open_edges,
    )


class _Points:
    """The points of each half except outliers, with their patches."""

    def __init__(self, scan: Scan):
        # The points of a scan lie along a space-filling curve: neighbours in the order are neighbours in space.
        patch = np.arange(len(scan.cloud)) * PATCHES // len(scan.cloud)
        self._all, self._patch, self._good = scan.cloud.points, patch, np.flatnonzero(~scan.outlier)
        rows = [np.flatnonzero(~scan.outlier & (scan.second == bool(half))) for half in (0, 1)]
        self.held = [(scan.cloud.points[chosen], patch[chosen]) for chosen in rows]
        self._trees = [cKDTree(points) for points, _ in self.held]
        self._tree = cKDTree(self._all[self._good])

    def nearest(self, points: np.ndarray, half: int) -> tuple[np.ndarray, np.ndarray]:
        """Distances of points (n, 3) to the nearest points of a half, and the patches of those."""
        distance, nearest = self._trees[half].query(points)
        return distance, self.held[half][1][nearest]

    def across(self, removed: np.ndarray, surface: MeshSurface, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Sums of the distances of removed points (a mask of all) to a surface, and of its samples nearest to them."""
        gone = self._good[removed[self._good]]
        to_mesh = _sums(surface.project(self._all[gone]).distance, self._patch[gone])
        samples, _ = surface.sample(SAMPLES, generator(seed, "gaps"))
        distance, at = self._tree.query(samples)
        at = self._good[at]
        near = removed[at]
        if not near.any():  # no surface there: as far from the points as they are from it
            return to_mesh, to_mesh
        return to_mesh, _sums(distance[near], self._patch[at[near]])


def _sums(values: np.ndarray, patch: np.ndarray) -> np.ndarray:
    """(2, PATCHES) array: the sums of values in each patch, and their number."""
    return np.stack([np.bincount(patch, values, PATCHES), np.bincount(patch, minlength=PATCHES)])
